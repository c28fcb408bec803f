import { readFileSync } from "node:fs";
import { join } from "node:path";
import { describe, expect, it } from "vitest";
import { agentsOf, decisionOf, markersOf, speedSeries } from "../src/agents";
import { Recording } from "../src/episode";
import { integrate } from "../src/arrays";
import { decodeContainer } from "../src/container";
import { decode } from "../src/format";
import { formatLink, parseLink } from "../src/link";
import { FormatError, unpack } from "../src/msgpack";
import { Clock } from "../src/playback";
import { Snapshot } from "../src/snapshot";
import { gridOf } from "../src/places";
import { Table } from "../src/tables";
import { bytesOf, FOLDER, random } from "./samples";

interface Expected {
  rows: number;
  steps: Record<string, number[][]>;
}

describe.each(["intersection", "bubbles"])("%s, written by Python", (name) => {
  const expected = JSON.parse(readFileSync(join(FOLDER, `${name}.json`), "utf8")) as Expected;

  it("has the rows that Python wrote", async () => {
    const { messages, damage } = await decodeContainer(bytesOf(name));
    expect(damage).toBe("");
    const rows = messages.map((message) => (message.type === "steps" ? message.flags.length : 0));
    expect(rows.reduce((a, b) => a + b)).toBe(expected.rows);
    const recording = new Recording(messages);
    const now = new Snapshot();
    for (const [step, wanted] of Object.entries(expected.steps)) {
      recording.sample(Number(step), now);
      expect(now.count).toBe(wanted.length);
      for (const [number, , x, y, heading, speed, steer, flags] of wanted) {
        const i = now.place[number];
        expect(100 * now.x[i]).toBeCloseTo(x, 1);
        expect(100 * now.y[i]).toBeCloseTo(y, 1);
        expect(Math.cos(now.heading[i])).toBeCloseTo(Math.cos((heading * Math.PI) / 1800), 3);
        expect(Math.sin(now.heading[i])).toBeCloseTo(Math.sin((heading * Math.PI) / 1800), 3);
        expect(100 * now.speed[i]).toBeCloseTo(speed, 1);
        expect((1800 / Math.PI) * now.steer[i]).toBeCloseTo(steer, 1);
        expect(now.flags[i]).toBe(flags);
      }
    }
  });

  it("plays up to a cut", async () => {
    const bytes = bytesOf(name);
    const whole = new Recording((await decodeContainer(bytes)).messages);
    for (let part = 1; part < 20; part++) {
      const cut = bytes.slice(0, Math.floor((bytes.length * part) / 20));
      try {
        const { messages, damage } = await decodeContainer(cut);
        expect(damage).not.toBe("");
        expect(new Recording(messages).lastStep).toBeLessThanOrEqual(whole.lastStep);
      } catch (error) {
        expect(error).toBeInstanceOf(FormatError);
      }
    }
  });

  it("never fails but by a FormatError, whatever a byte is", async () => {
    const bytes = bytesOf(name);
    const draw = random(7);
    for (let trial = 0; trial < 60; trial++) {
      const mutated = bytes.slice();
      for (let k = 0; k < 3; k++) mutated[Math.floor(draw() * mutated.length)] = Math.floor(draw() * 256);
      try {
        const recording = new Recording((await decodeContainer(mutated)).messages);
        recording.sample(recording.lastStep / 2, new Snapshot());
        markersOf(recording, agentsOf(recording));
      } catch (error) {
        expect(error).toBeInstanceOf(FormatError);
      }
    }
  });

  it("knows its agents", async () => {
    const recording = new Recording((await decodeContainer(bytesOf(name))).messages);
    const agents = agentsOf(recording);
    const ended = agents.filter((agent) => agent.endStep >= 0);
    expect(ended.length).toBeGreaterThan(0);
    for (const agent of ended) {
      const speeds = speedSeries(recording, agent);
      expect(speeds.values.every((speed) => speed >= -1 && speed < 60)).toBe(true);
      expect(speeds.steps.every((step, i) => i === 0 || step > speeds.steps[i - 1])).toBe(true);
    }
    expect(agents.some((agent) => decisionOf(recording, agent, recording.lastStep) !== null)).toBe(true);
    const markers = markersOf(recording, agents);
    expect(markers.every((marker, i) => i === 0 || marker.step >= markers[i - 1].step)).toBe(true);
  });
});

describe("messages", () => {
  it("decodes msgpack", () => {
    const bytes = Uint8Array.of(
      0x83,
      0xa1,
      0x61,
      0xcd,
      0x01,
      0x00,
      0xa1,
      0x62,
      0x92,
      0xff,
      0xc3,
      0xa1,
      0x63,
      0xcb,
      0x40,
      0x09,
      0x21,
      0xfb,
      0x54,
      0x44,
      0x2d,
      0x18,
    );
    expect({ ...(unpack(bytes) as object) }).toEqual({ a: 256, b: [-1, true], c: Math.PI });
  });

  it.each([
    [[0x81]],
    [[0xc1]],
    [[0xdd, 0xff, 0xff, 0xff, 0xff]],
    [[0x01, 0x02]],
    [[0x81, 0x90, 0x01]],
    [new Array<number>(64).fill(0x91)],
  ])("refuses damaged bytes %#", (bytes) => {
    expect(() => unpack(Uint8Array.from(bytes))).toThrow(FormatError);
  });

  it("ignores types of the future and refuses versions of the future", async () => {
    const text = (value: string) => [0xa0 + value.length, ...new TextEncoder().encode(value)];
    expect(await decode(Uint8Array.from([0x81, ...text("type"), ...text("hologram")]))).toBeNull();
    await expect(
      decode(Uint8Array.from([0x82, ...text("type"), ...text("episode"), ...text("version"), 99])),
    ).rejects.toThrow(FormatError);
  });

  it("sums zigzag differences within runs", () => {
    // Runs 5, 3 and -1, 1: differences 5, -2 and -1, 2; zigzag 10, 3, 1, 4; bytes shuffled.
    const bytes = new Uint8Array(16);
    bytes.set([10, 3, 1, 4]);
    expect([...integrate(bytes, Uint16Array.of(2, 2))]).toEqual([5, 3, -1, 1]);
  });
});

describe("tables", () => {
  it("appends rows of numbers, texts and lists", () => {
    const columns = () => ({
      step: Int32Array.of(1, 2),
      name: ["a", "b"],
      values: { values: Float32Array.of(1, 2, 3), offsets: Uint32Array.of(0, 1, 3) },
    });
    const table = new Table(columns());
    for (let i = 0; i < 5; i++) table.append(columns());
    expect(table.rows).toBe(12);
    expect([...table.numbers("step")].slice(-2)).toEqual([1, 2]);
    expect(table.texts("name")[11]).toBe("b");
    expect([...table.list("values", 11)]).toEqual([2, 3]);
  });
});

describe("the view", () => {
  it("comes back from its link", () => {
    const place = {
      episodes: ["3", "ab12"],
      t: 12.4,
      speed: 2,
      mode: "free" as const,
      agent: "agent & <b>",
      focus: 1,
      isInStep: false,
      orbit: { x: -1.5, y: 2, distance: 40, azimuth: 1.25, tilt: 0.5 },
    };
    expect(parseLink(formatLink(place))).toEqual(place);
  });

  it("takes nonsense in links as nothing", () => {
    expect(parseLink("#t=NaN&cam=upside&at=1,2,x&focus=-3&speed=")).toMatchObject({
      t: 0,
      mode: "top",
      orbit: null,
      focus: 0,
      speed: 1,
    });
  });

  it.each([
    [1, [1, 1]],
    [2, [2, 1]],
    [4, [2, 2]],
    [5, [3, 2]],
    [9, [3, 3]],
  ])("places %d in a grid", (count, grid) => {
    expect(gridOf(count, false)).toEqual(grid);
    expect(gridOf(count, true)).toEqual([...grid].reverse());
  });

  it("stops at the end, begins again, and follows what is live", () => {
    const clock = new Clock();
    clock.end = 10;
    clock.speed = 8;
    clock.play();
    clock.advance(2);
    expect([clock.t, clock.isPlaying]).toEqual([10, false]);
    clock.play();
    expect(clock.t).toBe(0);
    clock.isLive = true;
    clock.advance(0.1);
    expect(clock.t).toBeCloseTo(9.8);
  });
});
