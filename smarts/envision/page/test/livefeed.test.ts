/** Simulations that run: which messages go on with a recording, and which begin another. */

import { afterEach, describe, expect, it, vi } from "vitest";
import { decode } from "../src/format";
import { LiveFeed, PATIENCE } from "../src/livefeed";
import { cutShort } from "../src/titles";
import type { Message } from "../src/messages";
import { messageOf, stepsOf } from "./samples";

interface Inner {
  live: { take(message: unknown): void; socket: unknown };
}

/** A feed without a server: `send` takes up messages as the connection would. */
function fed(most?: number) {
  const replaced: string[] = [];
  const problems: string[] = [];
  const feed = new LiveFeed({
    changed: () => {},
    replaced: (id) => replaced.push(id),
    state: () => {},
    problem: (text) => problems.push(text),
  }, most);
  const { live } = feed as unknown as Inner;
  const send = (message: Message | object, serial = 1, source = "a") => live.take({ ...message, source, serial });
  const sent: unknown[] = [];
  vi.stubGlobal("WebSocket", { OPEN: 1 });
  live.socket = { readyState: 1, send: (text: string) => sent.push(JSON.parse(text)) };
  const list = (...running: string[]) => {
    const more = { host: "h", scenario: "s", episode: 1, policy: "" };
    const sources = ["a", "b"].map((id) => ({ id, title: `title ${id}`, running: running.includes(id), ...more }));
    live.take({ type: "sources", sources, hidden: 2 - running.length });
  };
  list("a", "b");
  for (const id of ["a", "b"]) feed.recording(id);
  return { feed, send, list, sent, replaced, problems };
}

const episode = async (number: number) =>
  (await decode(
    messageOf({ type: "episode", version: 1, facts: { dt: 0.1, episode: number }, names: {}, origin: [0, 0] }),
  ))!;
const steps = async (first: number, count: number, vehicles = 2) => (await decode(stepsOf(first, count, vehicles)))!;

describe("a simulation that runs", () => {
  it("goes on after a snapshot of the same episode", async () => {
    const { feed, send, replaced, problems } = fed();
    send(await episode(1));
    send(await steps(0, 20));
    const recording = feed.recording("a")!;
    expect(recording.length).toBe(20);
    send(await episode(1));
    send(await steps(30, 5));
    expect(feed.recording("a")).toBe(recording);
    expect([recording.firstStep, recording.lastStep, recording.length]).toEqual([0, 34, 25]);
    expect(feed.entries.filter((entry) => !entry.isLive)).toEqual([]);
    expect(replaced).toEqual(["a"]);
    expect(problems).toEqual([]);
  });

  it("has another recording in the next episode, and after a serial or facts that are others", async () => {
    const { feed, send, replaced } = fed();
    send(await episode(1));
    send(await steps(0, 20));
    send(await episode(2), 2);
    expect(feed.recording("a")!.length).toBe(0);
    send(await steps(0, 10), 2);
    send(await episode(2), 3);
    send(await steps(0, 10), 3);
    send(await episode(3), 3);
    expect(feed.entries.filter((entry) => !entry.isLive).length).toBe(3);
    expect(replaced).toEqual(["a", "a", "a", "a"]);
  });

  it("keeps no more than its share of memory, together with all others and the past", async () => {
    const most = 2_000_000;
    const { feed, send } = fed(most);
    for (let number = 0; number < 4; number++)
      for (const source of ["a", "b"]) {
        send(await episode(number), number, source);
        // 200 frames of 40 vehicles: 0.64 MB.
        for (let step = 0; step < 200; step++) send(await steps(step, 1, 40), number, source);
        expect(feed.bytes).toBeLessThanOrEqual(most);
        expect(feed.recording(source)!.length).toBe(200);
      }
    const past = feed.entries.filter((entry) => !entry.isLive);
    // The newest is still there.
    expect(past.length).toBe(1);
    expect(past[0].episode).toBe(2);
    // What runs is forgotten from its beginning.
    for (let step = 200; step < 2000; step++) send(await steps(step, 1, 40), 3, "a");
    expect(feed.bytes).toBeLessThanOrEqual(most);
    const recording = feed.recording("a")!;
    expect(recording.lastStep).toBe(1999);
    expect(recording.firstStep).toBeGreaterThan(1000);
    expect(feed.recording("b")!.length).toBeGreaterThan(50);
  });
});

const end = (isComplete: boolean, remark = "") => ({ type: "end", isComplete, remark });

const map = (digest: string) => ({ type: "map", digest, bounds: [0, 0, 1, 1], lanes: {}, edges: [] });

describe("the messages of a connection", () => {
  it("bring each map once", async () => {
    const { feed, send } = fed();
    send(await episode(1));
    send(map("m1"));
    const first = feed.recording("a")!.map;
    expect(first?.digest).toBe("m1");
    send(await episode(2), 2);
    send({ type: "known_map", digest: "m1" }, 2);
    expect(feed.recording("a")!.map).toBe(first);
    // Another simulation on the same roads.
    send(await episode(1), 1, "b");
    send({ type: "known_map", digest: "m1" }, 1, "b");
    expect(feed.recording("b")!.map).toBe(first);
    // The last 16 are kept.
    for (let i = 2; i < 18; i++) send(map(`m${i}`), 1, "b");
    send({ type: "known_map", digest: "m2" }, 1, "b");
    expect(() => send({ type: "known_map", digest: "m1" }, 1, "b")).toThrow("missing");
  });

  it("ask for what is watched and observed", async () => {
    const { feed, sent } = fed();
    feed.watch(["b", "c"]);
    feed.observe({ b: 3 });
    expect(sent).toEqual([
      { watch: ["b"], observe: {} },
      { watch: ["b"], observe: { b: 3 } },
    ]);
  });

  it("say how many simulations are not listed", () => {
    const { feed, list } = fed();
    expect(feed.hidden).toBe(0);
    list("a");
    expect(feed.hidden).toBe(1);
  });
});

describe("a simulation that ends", () => {
  afterEach(() => void vi.useRealTimers());

  it("is listed after running ones, and says why its episode was cut short", async () => {
    vi.useFakeTimers({ toFake: ["setTimeout"] });
    const { feed, send, list, problems } = fed();
    send(await episode(1));
    send(await steps(0, 20));
    send(end(false, "the simulation's process has gone"));
    list("b");
    expect(feed.ids).toEqual(["b", "a"]);
    expect(feed.entries.map(({ id, isRunning }) => [id, isRunning])).toEqual([
      ["a", false],
      ["b", true],
    ]);
    expect(cutShort(feed.recording("a")!)).toBe("the simulation's process has gone");
    expect(problems).toEqual([]);
    vi.advanceTimersByTime(PATIENCE);
    expect(problems).toEqual(["title a: the simulation's process has gone"]);
  });

  it("says nothing where it is complete, or the next episode begins", async () => {
    vi.useFakeTimers({ toFake: ["setTimeout"] });
    const { feed, send, problems } = fed();
    send(await episode(1));
    send(end(false, "reset before its end"));
    send(await episode(2), 2);
    send(end(true), 2);
    vi.advanceTimersByTime(PATIENCE);
    expect(problems).toEqual([]);
    expect(cutShort(feed.recording("a")!)).toBe("");
  });
});
