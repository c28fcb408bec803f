/** Whatever bytes come, the page says what is wrong with them, or shows them. */

import { deflateSync } from "node:zlib";
import { beforeAll, describe, expect, it } from "vitest";
import { agentsOf, decisionOf, extraSeries, markersOf, speedSeries, stateOf } from "../src/agents";
import { decodeContainer, readContainer } from "../src/container";
import { Recording } from "../src/episode";
import { decode } from "../src/format";
import type { Message } from "../src/messages";
import { FormatError, unpack } from "../src/msgpack";
import { lightsOf } from "../src/scene/overlays";
import { lanesOf, Roads } from "../src/scene/roads";
import { Snapshot } from "../src/snapshot";
import { array, bytesOf, containerOf, EPISODE, messageOf, messagesIn, random, stepsOf } from "./samples";

/** Changes, cuts, doubles or swaps some bytes. */
function mutate(bytes: Uint8Array, draw: () => number): Uint8Array {
  const at = () => Math.floor(draw() * bytes.length);
  const kind = draw();
  if (kind < 0.1) return bytes.slice(0, at());
  if (kind < 0.2) {
    const [from, to] = [at(), at()];
    return Uint8Array.from([...bytes.slice(0, from), ...bytes.slice(Math.min(from, to))]);
  }
  const out = bytes.slice();
  const interesting = [0, 1, 0x7f, 0x80, 0x90, 0xc0, 0xcb, 0xdd, 0xdf, 0xff];
  for (let k = 0; k < 1 + Math.floor(4 * draw()); k++)
    out[at()] = draw() < 0.5 ? interesting[Math.floor(draw() * interesting.length)] : Math.floor(256 * draw());
  return out;
}

/** Asks a recording for everything that the page asks for. */
function use(recording: Recording): void {
  const now = new Snapshot();
  for (const part of [0, 0.37, 1]) {
    const step = recording.firstStep + part * (recording.lastStep - recording.firstStep);
    recording.sample(step, now);
    recording.trail(now.number[0], step, 40, []);
    for (const agent of agentsOf(recording).slice(0, 20)) {
      stateOf(recording, agent, step);
      decisionOf(recording, agent, step);
    }
  }
  const agents = agentsOf(recording);
  markersOf(recording, agents);
  for (const agent of agents.slice(0, 20)) [speedSeries(recording, agent), extraSeries(recording, agent)];
  if (!recording.map) return;
  const lanes = lanesOf(recording.map);
  lightsOf(lanes);
  new Roads(lanes).dispose();
}

let seeds: Uint8Array[];
let map: Message | null;
beforeAll(async () => {
  const all = ["intersection", "bubbles"].flatMap((name) => messagesIn(bytesOf(name)));
  seeds = [...all.filter((message) => message.length < 5000), EPISODE, stepsOf(3, 5, 4)];
  map = await decode(all[1]);
});

describe("damaged inputs", () => {
  it("random bytes are msgpack or refused", () => {
    const draw = random(11);
    for (let trial = 0; trial < 500; trial++) {
      const bytes = Uint8Array.from({ length: 1 + Math.floor(64 * draw()) }, () => Math.floor(256 * draw()));
      try {
        unpack(bytes);
      } catch (error) {
        expect(error).toBeInstanceOf(FormatError);
      }
    }
  });

  it("damaged messages are decoded or refused, with a reason", async () => {
    const draw = random(12);
    let refused = 0;
    for (let trial = 0; trial < 1000; trial++) {
      const seed = seeds[Math.floor(draw() * seeds.length)];
      try {
        await decode(mutate(seed, draw));
      } catch (error) {
        expect(error).toBeInstanceOf(FormatError);
        expect((error as Error).message).toMatch(/^(a|an|the|lists|steps) [a-z]/);
        refused++;
      }
    }
    expect(refused).toBeGreaterThan(150);
    expect(refused).toBeLessThan(980);
  });

  it("recordings with damaged messages are shown or refused", async () => {
    const draw = random(13);
    let shown = 0;
    for (let trial = 0; trial < 150; trial++) {
      const chosen = Array.from({ length: 6 }, () => seeds[Math.floor(draw() * seeds.length)]);
      const damaged = chosen.map((message) => (draw() < 0.5 ? mutate(message, draw) : message));
      const recording = new Recording(map ? [map] : []);
      try {
        await readContainer(containerOf([EPISODE, ...damaged]), (message, packed) =>
          recording.add(message, packed),
        );
        shown++;
      } catch (error) {
        expect(error).toBeInstanceOf(FormatError);
      }
      use(recording);
    }
    expect(shown).toBeGreaterThan(130);
  });
});

describe("small inputs that ask for much memory", () => {
  const zeros = deflateSync(new Uint8Array(1 << 20));
  const steps = (x: object) => messageOf({ ...(unpack(stepsOf(0, 2, 2)) as object), x } as never);

  it.each([
    ["of 2 GB", { t: "u1", d: new Uint8Array(9), z: true, n: 2 ** 31 }],
    ["of a negative size", { t: "u1", d: new Uint8Array(9), z: true, n: -1 }],
    ["longer than it says", { t: "u1", d: Uint8Array.from(zeros), z: true, n: 100 }],
    ["shorter than it says", { t: "u1", d: Uint8Array.from(zeros), z: true, n: 2 ** 21 }],
    ["of a size that is a map", { t: "u1", d: Uint8Array.from(zeros), z: true, n: { a: 1 } }],
    ["of a type that objects have", { t: "constructor", d: new Uint8Array(8) }],
  ])("refuses an array %s", async (_, x) => {
    await expect(decode(steps(x))).rejects.toThrow(FormatError);
  });

  it("refuses many arrays that are large together", async () => {
    const big = { t: "u1", d: new Uint8Array(9), z: true, n: 30 << 20 };
    const columns = Object.fromEntries(Array.from({ length: 200 }, (_, i) => [`c${i}`, big]));
    await expect(decode(messageOf({ type: "table", name: "a", columns }))).rejects.toThrow(/damaged/);
    const good = { ...big, d: Uint8Array.from(deflateSync(new Uint8Array(30 << 20))) };
    const three = messageOf({ type: "table", name: "a", columns: { a: good, b: good, c: good } });
    await expect(decode(three)).rejects.toThrow(/larger than 64 MB/);
  });

  it("refuses millions of empty lists and of keys", () => {
    const many = (head: number, filler: number) => {
      const bytes = new Uint8Array(2_000_005).fill(filler);
      bytes.set([head, 0, 0x0f, 0x42, 0x40]);
      return bytes;
    };
    expect(() => unpack(many(0xdd, 0x90))).toThrow(/too many parts/);
    expect(() => unpack(many(0xdf, 0x01))).toThrow(/too many parts/);
  });

  it("ignores vehicles with numbers that there cannot be", async () => {
    const vehicles = messageOf({
      type: "vehicles",
      number: array(Uint32Array.of(4_000_000_000, 7)),
      slot: array(Int32Array.of(0, 1)),
      generation: array(Int32Array.of(1, 1)),
    });
    const { messages } = await decodeContainer(containerOf([EPISODE, vehicles]));
    expect(new Recording(messages).vehicles.length).toBe(8);
  });

  it("draws dashed lines of a map as large as the earth in bounded memory", async () => {
    const far = 2 ** 31 - 1;
    const lanes = 40;
    const lane = (value: number) => array(new Uint8Array(lanes).fill(value));
    const message = await decode(
      messageOf({
        type: "map",
        bounds: [0, 0, 1, 1],
        edges: [],
        lanes: {
          start: array(Uint32Array.from({ length: lanes + 1 }, (_, i) => 2 * i)),
          x: array(Int32Array.from({ length: 2 * lanes }, (_, i) => (i % 2 ? far : 0))),
          y: array(new Int32Array(2 * lanes)),
          width: array(new Uint16Array(lanes).fill(320)),
          ...Object.fromEntries(["kind", "junction", "right", "stop", "signal", "edge"].map((n) => [n, lane(0)])),
          left: lane(1),
        },
      }),
    );
    if (message?.type !== "map") throw new Error("no map");
    const roads = new Roads(lanesOf(message));
    const vertices = roads.meshes[2].geometry.getAttribute("position").count;
    expect(vertices).toBeGreaterThan(100_000);
    expect(vertices).toBeLessThan(2_000_000);
  });
});

it("ignores names that objects have by themselves", async () => {
  const names = { ActionSpaceType: { "0": "constructor" }, Outcome: { "1": "toString" }, Reason: { "0": "valueOf" } };
  const episode = messageOf({ type: "episode", version: 1, facts: { dt: 0.1, scenario: [1] }, names, origin: [0] });
  const agents = messageOf({
    type: "table",
    name: "agents",
    columns: {
      outcome: array(Int8Array.of(1)),
      end_step: array(Int32Array.of(2)),
      entry_step: array(Int32Array.of(0)),
      interface: array(Int8Array.of(-1)),
      name: [["a list"]],
    },
  });
  const decisions = messageOf({
    type: "table",
    name: "decisions",
    columns: {
      step: array(Int32Array.of(1)),
      agent: array(Int32Array.of(0)),
      action: array(Int8Array.of(0)),
      value_0: array(Float32Array.of(0.5)),
    },
  });
  const { messages } = await decodeContainer(containerOf([episode, agents, decisions, stepsOf(0, 4, 1)]));
  const recording = new Recording(messages);
  const [agent] = agentsOf(recording);
  expect(agent.outcomeText).toBe("tostring");
  expect(decisionOf(recording, agent, 2)?.parts).toEqual([{ name: "value 0", value: 0.5, low: -1, high: 1 }]);
  expect(recording.facts.scenario).toBeUndefined();
});
