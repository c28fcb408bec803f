/** Recordings that are long or live: what is kept, and what is found of it. */

import { describe, expect, it } from "vitest";
import { agentsOf, speedSeries } from "../src/agents";
import { Chunks } from "../src/chunks";
import { readContainer } from "../src/container";
import { Recording } from "../src/episode";
import { decode } from "../src/format";
import type { Message } from "../src/messages";
import { Snapshot } from "../src/snapshot";
import { Table } from "../src/tables";
import { array, bytesOf, containerOf, EPISODE, messageOf, stepsOf } from "./samples";

const decoded = async (bytes: Uint8Array): Promise<Message> => (await decode(bytes))!;

/** The states of some vehicles as an agent's, from step to step. */
function statesOf(steps: number[], agent = 0): Uint8Array {
  const same = (value: number) => array(new Int32Array(steps.length).fill(value));
  return messageOf({
    type: "table",
    name: "agent_states",
    append: true,
    columns: {
      step: array(Int32Array.from(steps)),
      agent: same(agent),
      slot: same(0),
      generation: same(1),
      state: same(1),
      events: same(0),
    },
  });
}

const VEHICLE = messageOf({
  type: "vehicles",
  number: array(Uint32Array.of(0)),
  slot: array(Int32Array.of(0)),
  generation: array(Int32Array.of(1)),
  name: ["car"],
});
const AGENT = messageOf({
  type: "table",
  name: "agents",
  columns: {
    name: ["ego"],
    interface: array(Int8Array.of(-1)),
    entry_step: array(Int32Array.of(0)),
    end_step: array(Int32Array.of(-1)),
    outcome: array(Int8Array.of(0)),
  },
});

describe("the pose of an agent's vehicle", () => {
  const recorded = async () => {
    const messages = [EPISODE, VEHICLE, AGENT, statesOf([0, 1, 2, 3, 4, 5, 6, 7, 8]), stepsOf(0, 10, 2)];
    return new Recording(await Promise.all(messages.map(decoded)));
  };

  it("is that of the step asked for, whatever time is shown", async () => {
    const recording = await recorded();
    // Vehicle 0 drives 1 m a step to the north.
    for (const step of [0, 3, 8]) expect(recording.poseOf(0, step)).toEqual([0, step, 0]);
  });

  it("is not known where the agent has no vehicle, nor of other agents and steps", async () => {
    const recording = await recorded();
    for (const [agent, step] of [[0, 9], [0, 20], [0, -1], [1, 3]]) expect(recording.poseOf(agent, step)).toBeNull();
    expect(new Recording().poseOf(0, 0)).toBeNull();
  });
});

describe("a recording that is longer than what is kept", () => {
  const CHUNKS = 30;
  const STEPS = 100;
  const CARS = 20;

  it("has the same states everywhere as one that is kept whole", async () => {
    // 60,000 states, of which 1 MB holds 33,000.
    const messages = [EPISODE, VEHICLE, AGENT];
    for (let i = 0; i < CHUNKS; i++) {
      const first = i * STEPS;
      messages.push(statesOf(Array.from({ length: STEPS }, (_, k) => first + k)));
      messages.push(stepsOf(first, STEPS, CARS));
    }
    const recording = new Recording([], false, new Chunks(1_000_000));
    const bytes = containerOf(messages);
    expect(await readContainer(bytes, (message, packed) => recording.add(message, packed))).toBe("");
    const now = new Snapshot();
    let waited = 0;
    for (const step of [0, 50.5, 99.5, 1234.25, 2999, 3, 2000]) {
      while (!recording.sample(step, now)) {
        waited++;
        await new Promise<void>((resolve) => (recording.chunks.onArrival = resolve));
      }
      // The chunk after it may be on its way, too: then nothing is interpolated across the border yet.
      while (Math.floor(step) % STEPS === STEPS - 1 && Math.abs(now.y[7] - step) > 0.01) {
        await new Promise((resolve) => setTimeout(resolve, 5));
        recording.sample(step, now);
      }
      expect(now.count).toBe(CARS);
      expect(now.x[7]).toBeCloseTo(70);
      expect(now.y[7]).toBeCloseTo(step, 2);
      expect(now.speed[7]).toBeCloseTo(0.01 * step, 4);
      expect(now.agent[0]).toBe(0);
    }
    expect(waited).toBeGreaterThan(0);
    const speeds = speedSeries(recording, agentsOf(recording)[0]);
    expect(speeds.values.length).toBe(CHUNKS * STEPS);
    expect(speeds.values[1234]).toBeCloseTo(12.34);
    expect(recording.reach).toEqual({ x0: 0, y0: 0, x1: 0, y1: CHUNKS * STEPS - 1 });
  });

  it("keeps no more than it may", async () => {
    const chunks = new Chunks(1_000_000);
    const packed = stepsOf(0, 100, 100);
    const message = await decoded(packed);
    if (message.type !== "steps") throw new Error("no steps");
    const all = Array.from({ length: 20 }, () => chunks.add(message, packed));
    // 300 kB each.
    expect(all.filter((chunk) => chunk.states).length).toBe(4);
    expect(all[19].states).not.toBeNull();
    expect(chunks.get(all[0])).toBeNull();
    await new Promise<void>((resolve) => (chunks.onArrival = resolve));
    expect([...(chunks.get(all[0])?.y ?? [])]).toEqual([...message.y]);
    expect(all.filter((chunk) => chunk.states).length).toBe(4);
    expect(all[16].states).toBeNull();
  });
});

describe("a long recording", () => {
  it("has all rows of its tables", () => {
    const table = new Table({ step: Int32Array.of(0), name: ["a"] });
    const rows = 300_000;
    for (let part = 0; part < 3; part++)
      table.append({
        step: Int32Array.from({ length: rows }, (_, i) => 1 + part * rows + i),
        name: new Array<string>(rows).fill("b"),
      });
    expect(table.rows).toBe(3 * rows + 1);
    expect(table.numbers("step")[500_000]).toBe(500_000);
    expect([table.texts("name")[0], table.texts("name")[3 * rows]]).toEqual(["a", "b"]);
  });

  it("drops columns that later rows do not have", () => {
    const table = new Table({ step: Int32Array.of(0), x: Int32Array.of(5) });
    table.append({ step: Int32Array.of(1) });
    expect([table.rows, table.numbers("x").length]).toEqual([2, 0]);
  });

  it("chooses rows of numbers, texts and lists", () => {
    const lists = { values: Float32Array.of(1, 2, 3), offsets: Uint32Array.of(0, 1, 1, 3) };
    const kept = new Table({ step: Int32Array.of(4, 5, 6), name: ["a", "b", "c"], lists }).kept([0, 2]);
    expect([...kept.numbers("step")]).toEqual([4, 6]);
    expect(kept.texts("name")).toEqual(["a", "c"]);
    expect([...kept.list("lists", 1)]).toEqual([2, 3]);
  });
});

describe("what is live", () => {
  it("keeps the last minute, and lights that have not changed since", async () => {
    const recording = new Recording([await decoded(EPISODE), await decoded(VEHICLE), await decoded(AGENT)], true);
    const light = messageOf({
      type: "table",
      name: "signals",
      append: true,
      columns: {
        step: array(Int32Array.of(0, 5)),
        lane: array(Int32Array.of(3, 3)),
        signal: array(Int8Array.of(1, 2)),
      },
    });
    recording.add(await decoded(light));
    const frame = await decoded(stepsOf(0, 1, 3));
    if (frame.type !== "steps") throw new Error("no steps");
    const state = await decoded(statesOf([0]));
    if (state.type !== "table") throw new Error("no table");
    const LAST = 9000;
    for (let step = 0; step <= LAST; step++) {
      const columns = { ...state.columns, step: Int32Array.of(step) };
      recording.add({ ...state, columns });
      recording.add({ ...frame, step: Int32Array.of(step), speed: Int32Array.of(step, 0, 0) });
    }
    // A minute at 60 frames a second.
    expect(recording.length).toBeGreaterThan(3600);
    expect(recording.length).toBeLessThanOrEqual(8000);
    expect(recording.lastStep).toBe(LAST);
    const { firstStep } = recording;
    expect(recording.table("agent_states").rows).toBe(LAST - firstStep + 1);
    const row = recording.index("signals", "lane").at(3, LAST);
    expect(recording.table("signals").numbers("signal")[row]).toBe(2);
    const speeds = speedSeries(recording, agentsOf(recording)[0]);
    expect([speeds.steps[0], speeds.values[0]]).toEqual([firstStep, expect.closeTo(0.01 * firstStep)]);
    const now = new Snapshot();
    expect(recording.sample(firstStep, now)).toBe(true);
    expect(now.agent[0]).toBe(0);
  });
});

it("finds in each fixture the same speeds as in its states", async () => {
  const recording = new Recording();
  await readContainer(bytesOf("bubbles"), (message, packed) => recording.add(message, packed));
  const now = new Snapshot();
  let compared = 0;
  for (const agent of agentsOf(recording).slice(0, 6)) {
    const series = speedSeries(recording, agent);
    series.steps.forEach((step, i) => {
      recording.sample(step, now);
      const place = now.agent.subarray(0, now.count).indexOf(agent.row);
      if (place < 0) return;
      compared++;
      expect(series.values[i]).toBeCloseTo(now.speed[place], 4);
    });
  }
  expect(compared).toBeGreaterThan(100);
});
