/** What agents observe: read from a recording, placed, coloured. */

import { describe, expect, it } from "vitest";
import { agentsOf, decisionOf, extraSeries } from "../src/agents";
import { decodeContainer } from "../src/container";
import { Recording } from "../src/episode";
import { groundOf, observedBy, pixelsOf } from "../src/observed";
import { array, containerOf, messageOf, stepsOf } from "./samples";

const AGENTS = messageOf({
  type: "table",
  name: "agents",
  columns: {
    name: ["ego"],
    interface: array(Int8Array.of(-1)),
    entry_step: array(Int32Array.of(0)),
    end_step: array(Int32Array.of(-1)),
  },
});

/** A recording whose agent observes; rows are step, name, numbers. */
async function recorded(table: string, rows: [number, string, number[]][], isLive = false): Promise<Recording> {
  const offsets = [0];
  for (const [, , values] of rows) offsets.push(offsets[offsets.length - 1] + values.length);
  const lists = array(Float32Array.from(rows.flatMap(([, , values]) => values)));
  const message = messageOf({
    type: "table",
    name: table,
    append: true,
    columns: {
      step: array(Int32Array.from(rows, ([step]) => step)),
      agent: array(new Int32Array(rows.length)),
      name: rows.map(([, name]) => name),
      values: { ...(lists as object), o: array(Uint32Array.from(offsets)) } as never,
    },
  });
  const decisions = messageOf({
    type: "table",
    name: "decisions",
    columns: {
      step: array(Int32Array.of(0)),
      agent: array(Int32Array.of(0)),
      action: array(Int8Array.of(3)),
      value_0: array(Float32Array.of(0.5)),
      value_1: array(Float32Array.of(-0.25)),
    },
  });
  const names = { ActionSpaceType: { "3": "LaneWithContinuousSpeed" } };
  const episode = messageOf({ type: "episode", version: 1, facts: { dt: 0.1 }, names, origin: [0, 0] });
  const { messages } = await decodeContainer(containerOf([episode, AGENTS, message, decisions, stepsOf(0, 40, 1)]));
  return new Recording(messages, isLive);
}

const observed = async (rows: [number, string, number[]][], step: number, isLive = false) => {
  const recording = await recorded("observations", rows, isLive);
  return observedBy(recording, agentsOf(recording)[0], step);
};

describe("observations", () => {
  it("are parted into paths at pairs that are no numbers", async () => {
    const found = await observed([[1, "waypoints", [1, 2, 3, 4, NaN, NaN, 5, 6, 7, 8, 9, 10]]], 1);
    expect(found?.waypoints.map((path) => [...path])).toEqual([
      [1, 2, 3, 4],
      [5, 6, 7, 8, 9, 10],
    ]);
    expect((await observed([[1, "waypoints", [NaN, NaN, 5, 6, 7]]], 1))?.waypoints.map((p) => [...p])).toEqual([[5, 6]]);
    expect((await observed([[1, "waypoints", []]], 1))?.waypoints).toEqual([]);
  });

  it("have neighbours of six numbers each", async () => {
    const found = await observed([[1, "neighbors", [10, 20, 0.5, 4, 2, 8, NaN, 0, 0, 4, 2, 0, 1]]], 1);
    expect(found?.neighbors).toEqual([{ x: 10, y: 20, heading: 0.5, length: 4, width: 2, speed: 8 }]);
  });

  it("hold until the next of the same name, a second at most", async () => {
    const rows: [number, string, number[]][] = [
      [3, "lidar", [1, 1]],
      [5, "speed", [7]],
      [9, "lidar", [2, 2, 3, 3]],
    ];
    const lidar = async (step: number) => [...((await observed(rows, step))?.lidar ?? [])];
    expect(await lidar(2)).toEqual([]);
    expect(await lidar(8)).toEqual([1, 1]);
    expect(await lidar(9)).toEqual([2, 2, 3, 3]);
    expect(await lidar(19)).toEqual([2, 2, 3, 3]);
    expect(await observed(rows, 20)).toBeNull();
    expect((await observed(rows, 15))?.others).toEqual([["speed", Float32Array.of(7)]]);
    expect((await observed(rows, 16))?.others).toEqual([]);
    // Live, a simulation may run much faster than its time.
    expect((await observed(rows, 16, true))?.others.length).toBe(1);
    expect((await observed(rows, 60, true))).toBeNull();
  });

  it("have a grid on the ground that is of the step in which it was seen", async () => {
    const grid = [1, 1, 0.5, 1];
    const rows: [number, string, number[]][] = [
      [4, "grid:drivable", grid],
      [4, "grid:occupancy", grid],
      [9, "grid:drivable", grid],
    ];
    const ground = async (step: number) => groundOf(await observed(rows, step));
    expect(await ground(3)).toBeUndefined();
    expect(await ground(8)).toMatchObject({ name: "occupancy", step: 4 });
    expect(await ground(12)).toMatchObject({ name: "occupancy", step: 4 });
    expect(await ground(16)).toMatchObject({ name: "drivable", step: 9 });
  });

  it("have grids whose first cell is ahead to the left; damaged ones are left out", async () => {
    const grid = [2, 3, 0.5, 1, 0, 0, 0, 0, 0.5];
    const found = await observed(
      [
        [1, "grid:occupancy", grid],
        [1, "rgb:top_down", [1, 1, 2, 1, 0.5, 0]],
        [1, "grid:short", grid.slice(0, -1)],
        [1, "grid:huge", [1e6, 1e6, 1]],
        [1, "grid:negative", [-2, -3, 1, 0, 0, 0, 0, 0, 0]],
      ],
      1,
    );
    expect(found?.grids.map(({ name, height, width, size }) => [name, height, width, size])).toEqual([
      ["occupancy", 2, 3, 0.5],
      ["top_down", 1, 1, 2],
    ]);
    const pixels = pixelsOf(found!.grids[0], [1, 0.5, 0], 0.8);
    expect([...pixels.subarray(0, 8)]).toEqual([255, 128, 0, 204, 255, 128, 0, 0]);
    expect(pixels[4 * 5 + 3]).toBe(102);
    expect([...pixelsOf(found!.grids[1], [0, 0, 0], 1)]).toEqual([255, 128, 0, 255]);
  });
});

it("shows means and deviations of continuous actions", async () => {
  const recording = await recorded("extras", [
    [0, "mean", [0.4, -0.2]],
    [0, "std", [0.1, 0.05]],
    [0, "reward", [1]],
  ]);
  const decision = decisionOf(recording, agentsOf(recording)[0], 5);
  // The range counts as -1 to 1: of the target speed 0 to 60 m/s, of the lane change -1 to 1.
  expect(decision?.parts.map(({ name }) => name)).toEqual(["target speed", "lane change"]);
  expect(decision?.means?.[0]).toBeCloseTo(42);
  expect(decision?.means?.[1]).toBeCloseTo(-0.2);
  expect(decision?.deviations?.[0]).toBeCloseTo(3);
  expect(decision?.deviations?.[1]).toBeCloseTo(0.05);
  expect(decision?.probabilities).toBeNull();
  expect(extraSeries(recording, agentsOf(recording)[0]).map(({ name }) => name)).toEqual(["reward"]);
});

it("shows no distribution of an action that has other parts", async () => {
  const recording = await recorded("extras", [
    [0, "mean", [0.4, -0.2, 0.1]],
    [0, "std", [0.1, 0.05, 0.1]],
  ]);
  expect(decisionOf(recording, agentsOf(recording)[0], 5)).toMatchObject({ means: null, deviations: null });
});
