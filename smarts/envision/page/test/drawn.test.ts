/** What is drawn of an episode that Python wrote: the numbers that the graphics driver gets. */

import type { Mesh } from "three";
import { describe, expect, it } from "vitest";
import { markersOf } from "../src/agents";
import { decodeContainer } from "../src/container";
import { Recording } from "../src/episode";
import { groundOf, observedBy, pixelsOf } from "../src/observed";
import { DARK, type Rgb, STOP_LIGHT } from "../src/scene/palette";
import type { Lane } from "../src/scene/roads";
import { AIR_LOCK, COLLIDED, Driver, Snapshot } from "../src/snapshot";
import { View } from "../src/view";
import { bytesOf } from "./samples";

const [BRAKE, LEFT, RIGHT] = [1 << 3, 1 << 4, 1 << 5];

async function viewOf(name: string): Promise<View> {
  const { messages } = await decodeContainer(bytesOf(name));
  const view = new View("a", name, new Recording(messages));
  view.rig.resize(1200, 900);
  view.rig.sees = () => true;
  return view;
}

/** Shows a step, with all vehicles in the picture; from a distance they have fewer corners. */
async function show(view: View, step: number, distance = 100): Promise<void> {
  view.clock.t = step * view.recording.dt;
  view.rig.aim.distance = distance;
  do {
    view.update(10, DARK);
    await new Promise((resolve) => setTimeout(resolve));
  } while (view.isDirty);
}

/** A private part of an object. */
const part = <T>(from: unknown, name: string) => (from as Record<string, T>)[name];

/** Whether numbers begin with some. */
const near = (a: ArrayLike<number>, b: ArrayLike<number>, precision = 0.02) =>
  Array.from(b).every((value, i) => Math.abs(value - a[i]) < precision);

interface Numbers {
  count: number;
  values: Float32Array;
  stride: number;
  stencil?: { corners: number };
}

/** The numbers of each instance or copy. */
const rowsOf = (from: Numbers): Float32Array[] =>
  Array.from({ length: from.count }, (_, i) => {
    const at = i * from.stride * (from.stencil?.corners ?? 1);
    return from.values.slice(at, at + from.stride);
  });
const decalsOf = (from: unknown) => rowsOf(part<Numbers>(from, "copies"));
const overlaysOf = (view: View) => part<Record<string, unknown>>(view, "overlays");

/** The points of ribbons, both of each pair of corners, as far as they are drawn. */
function pointsOf(mesh: Mesh): { x: number; y: number; colour: number[] }[] {
  if (!mesh.visible) return [];
  const [position, colour] = ["position", "colour"].map((name) => mesh.geometry.getAttribute(name));
  const drawn = new Set(Array.from(mesh.geometry.index!.array).slice(0, mesh.geometry.drawRange.count));
  return [...drawn].map((i) => ({
    x: position.getX(i),
    y: position.getY(i),
    colour: [colour.getX(i), colour.getY(i), colour.getZ(i)],
  }));
}
const cornersOf = ({ points }: Lane) =>
  Array.from({ length: points.length >> 1 }, (_, i) => ({ x: points[2 * i], y: points[2 * i + 1] }));
const isThere = (points: { x: number; y: number }[], x: number, y: number) =>
  points.some((each) => Math.hypot(each.x - x, each.y - y) < 0.02);

/** Of each vehicle that is drawn: x, y, heading, angle of the wheels; length, width, height, lights; colour. */
function bodiesOf(view: View): Float32Array[] {
  const fleets = part<{ used: Numbers }[]>(part(view, "bodies"), "fleets");
  return fleets.flatMap(({ used }) => rowsOf(used));
}

describe.each(["intersection", "bubbles"])("vehicles of %s", (name) => {
  it("have the place, wheels, lights and colour of their drivers, near and far", async () => {
    const view = await viewOf(name);
    const seen = { brake: 0, left: 0, right: 0, steered: 0, striped: 0, drivers: new Set<number>() };
    for (let step = view.recording.firstStep; step < view.recording.lastStep; step += 7) {
      await show(view, step, step % 2 ? 100 : 900);
      const { now } = view;
      const drawn = bodiesOf(view);
      expect(drawn.length).toBe(now.count);
      for (let i = 0; i < now.count; i++) {
        const body = drawn.find((each) => near(each, [now.x[i], now.y[i]], 0.001))!;
        expect(near(body.slice(2, 4), [now.heading[i], now.steer[i]], 1e-5)).toBe(true);
        expect(body[7]).toBe(now.flags[i] & (BRAKE | LEFT | RIGHT | AIR_LOCK | COLLIDED));
        expect(near(body.slice(8), DARK.drivers[now.driver[i] as Driver], 1e-5)).toBe(true);
        seen.brake += now.flags[i] & BRAKE ? 1 : 0;
        seen.left += now.flags[i] & LEFT ? 1 : 0;
        seen.right += now.flags[i] & RIGHT ? 1 : 0;
        seen.striped += now.flags[i] & AIR_LOCK ? 1 : 0;
        seen.steered += Math.abs(now.steer[i]) > 0.05 ? 1 : 0;
        seen.drivers.add(now.driver[i]);
      }
    }
    // All of these occur, so that none of them is drawn by chance.
    expect(seen.brake * seen.left * seen.right * seen.steered).toBeGreaterThan(0);
    expect(seen.drivers).toContain(Driver.Ego);
    expect(seen.drivers).toContain(Driver.Traffic);
    if (name === "bubbles") {
      expect(seen.drivers).toContain(Driver.Social);
      expect(seen.striped).toBeGreaterThan(0);
    }
  });

  it("glow behind while they brake", async () => {
    const view = await viewOf(name);
    let glows = 0;
    for (let step = view.recording.firstStep; step < view.recording.lastStep; step += 11) {
      await show(view, step);
      const red = decalsOf(overlaysOf(view).shadows).filter((each) => near(each.slice(8, 11), STOP_LIGHT, 1e-5));
      const { now } = view;
      const braking = [...Array(now.count).keys()].filter((i) => now.flags[i] & BRAKE);
      expect(red.length).toBe(braking.length);
      for (const i of braking) {
        const back = (view.recording.vehicles[now.number[i]]!.length) / 2 + 0.45;
        const place = [now.x[i] - back * Math.cos(now.heading[i]), now.y[i] - back * Math.sin(now.heading[i])];
        expect(red.some((each) => near(each, place))).toBe(true);
        glows++;
      }
    }
    expect(glows).toBeGreaterThan(0);
  });

  it("of agents have trails along the places where they were, those of traffic have none", async () => {
    const view = await viewOf(name);
    const step = Math.floor((view.recording.firstStep + view.recording.lastStep) / 2);
    await show(view, step);
    const before = new Snapshot();
    view.recording.sample(step - 10, before);
    const points = pointsOf(overlaysOf(view).trails && part<Mesh>(overlaysOf(view).trails, "mesh"));
    let trails = 0;
    for (let i = 0; i < view.now.count; i++) {
      const was = before.place[view.now.number[i]];
      if (was < 0) continue;
      const hasTrail = view.now.agent[i] >= 0 && view.now.driver[i] !== Driver.Traffic;
      const hasMoved = Math.hypot(before.x[was] - view.now.x[i], before.y[was] - view.now.y[i]) > 1;
      if (!hasTrail && !hasMoved) continue;
      expect(isThere(points, before.x[was], before.y[was])).toBe(hasTrail);
      expect(isThere(points, view.now.x[i], view.now.y[i])).toBe(hasTrail);
      trails += hasTrail ? 1 : 0;
    }
    expect(trails).toBeGreaterThan(0);
  });
});

describe("the chosen agent", () => {
  it("has its route on the road, each edge of it, and no other agent's", async () => {
    const view = await viewOf("intersection");
    const routes = view.recording.table("routes");
    const lanes = part<Lane[]>(view, "lanes");
    let others = 0;
    for (const agent of view.agents) {
      view.choose(agent);
      await show(view, agent.entryStep + 5);
      const points = pointsOf(part<Mesh>(overlaysOf(view).route, "mesh"));
      const edges = Array.from(routes.list("edges", routes.numbers("route").indexOf(agent.route)));
      expect(edges.length).toBeGreaterThan(1);
      for (const edge of edges)
        for (const lane of lanes.filter((each) => each.edge === edge && each.kind < 2 && each.points.length >= 4))
          expect(isThere(points, lane.points[0], lane.points[1])).toBe(true);
      for (const other of lanes.filter(({ edge, kind }) => edge >= 0 && kind < 2 && !edges.includes(edge))) {
        const [x, y] = [other.points[2], other.points[3]];
        if (lanes.some((lane) => edges.includes(lane.edge) && isThere(cornersOf(lane), x, y)) || other.isJunction) continue;
        expect(isThere(points, x, y)).toBe(false);
        others++;
      }
      for (const { colour } of points) expect(near(colour, DARK.route, 1e-5)).toBe(true);
    }
    expect(others).toBeGreaterThan(0);
    view.choose(null);
    await show(view, 20);
    expect(pointsOf(part<Mesh>(overlaysOf(view).route, "mesh"))).toEqual([]);
  });

  it("has a ring about its vehicle in its colour", async () => {
    const view = await viewOf("intersection");
    for (const agent of view.agents.slice(0, 2)) {
      view.choose(agent);
      await show(view, agent.entryStep + 5);
      const place = view.now.agent.subarray(0, view.now.count).indexOf(agent.row);
      const rings = decalsOf(overlaysOf(view).rings);
      expect(rings.length).toBe(1);
      expect(near(rings[0], [view.now.x[place], view.now.y[place], view.now.heading[place]])).toBe(true);
      expect(near(rings[0].slice(12, 15), DARK.drivers[Driver.Ego], 1e-5)).toBe(true);
    }
  });

  it("has a goal that stands out; others have theirs until they have ended", async () => {
    const view = await viewOf("intersection");
    const [chosen] = view.agents;
    view.choose(chosen);
    const step = Math.max(...view.agents.map((agent) => agent.endStep));
    for (const at of [chosen.entryStep + 5, step + 1]) {
      await show(view, Math.min(at, view.recording.lastStep));
      const goals = part<Map<number, { mesh: Mesh }>>(overlaysOf(view), "goals");
      expect(view.agents.every((agent) => agent.goal !== null)).toBe(true);
      for (const agent of view.agents) {
        const { mesh } = goals.get(agent.row)!;
        const isOver = view.step > agent.endStep;
        expect(mesh.visible).toBe(agent === chosen || (view.step >= agent.entryStep && !isOver));
        expect(near(mesh.position.toArray(), [agent.goal!.x, agent.goal!.y, 0], 1e-4)).toBe(true);
        const colour = part<{ uniforms: { colour: { value: Rgb } } }>(mesh, "material").uniforms.colour.value;
        expect(colour).toBe(agent === chosen ? DARK.goal : DARK.drivers[Driver.Ego]);
      }
    }
  });

  it("has what it observes about it: waypoints, neighbours, lidar points, a grid where it was seen", async () => {
    const view = await viewOf("observed");
    const sight = part<Record<string, unknown>>(view, "sight");
    const found = { waypoints: 0, neighbors: 0, lidar: 0, grids: 0 };
    for (let step = view.recording.firstStep; step <= view.recording.lastStep; step += 5) {
      await show(view, step);
      const observed = view.chosen && observedBy(view.recording, view.chosen, step);
      const marks = decalsOf(sight.marks);
      const points = pointsOf(part<Mesh>(sight.paths, "mesh"));
      const paths = observed?.waypoints ?? [];
      const [corners, neighbors, lidar] = [paths.flatMap((path) => [...path]), observed?.neighbors ?? [], observed?.lidar ?? []];
      expect(marks.length).toBe(corners.length / 2 + neighbors.length + lidar.length / 2);
      for (const path of paths) if (path.length >= 4) expect(isThere(points, path[0], path[1])).toBe(true);
      for (const { x, y, heading } of neighbors) expect(marks.some((each) => near(each, [x, y, heading]))).toBe(true);
      for (let i = 0; i < lidar.length; i += 2)
        expect(marks.some((each) => near(each, [lidar[i], lidar[i + 1]]) && near(each.slice(8, 11), DARK.lidar))).toBe(true);
      const [floor, ground] = [part<Mesh>(sight.floor, "mesh"), groundOf(observed)];
      const pose = ground ? view.recording.poseOf(view.chosen!.row, ground.step) : null;
      expect(floor.visible).toBe(pose !== null);
      if (ground && pose) {
        expect(near([...floor.position.toArray().slice(0, 2), floor.rotation.z], pose, 1e-4)).toBe(true);
        expect(near(floor.scale.toArray(), [ground.height * ground.size, ground.width * ground.size], 1e-4)).toBe(true);
        const { cells } = part<{ uniforms: Record<string, { value: { image: { data: Uint8Array } } }> }>(floor, "material").uniforms;
        expect([...cells.value.image.data]).toEqual([...pixelsOf(ground, DARK.sight, 0.42)]);
        found.grids++;
      }
      found.waypoints += corners.length;
      found.neighbors += neighbors.length;
      found.lidar += lidar.length;
    }
    for (const count of Object.values(found)) expect(count).toBeGreaterThan(0);
  });
});

describe("a bubble", () => {
  it("has a membrane and a margin along its outlines, where it is, brighter while it takes vehicles", async () => {
    const view = await viewOf("bubbles");
    const rings = view.recording.table("bubble_rings");
    const [x0, y0] = view.recording.origin;
    const poses = view.recording.table("bubble_poses");
    const [steps, bubbles, xs, ys, on] = ["step", "bubble", "x", "y", "is_active"].map((name) => poses.numbers(name));
    expect(rings.rows).toBeGreaterThan(0);
    for (const row of [0, poses.rows - 1]) {
      await show(view, Math.min(steps[row], view.recording.lastStep));
      const all = part<Record<string, unknown>[]>(part(view, "bubbles"), "parts");
      const parts = all.find(({ bubble }) => bubble === bubbles[row])!;
      for (const [name, isMargin] of [["zone", 0], ["margin", 1]] as const) {
        const mesh = part<Mesh>(parts[name], "mesh");
        expect(mesh.visible).toBe(true);
        expect(near(mesh.position.toArray(), [xs[row] - x0, ys[row] - y0, 0], 1e-3)).toBe(true);
        const position = mesh.geometry.getAttribute("position");
        const corners = Array.from({ length: position.count }, (_, i) => ({ x: position.getX(i), y: position.getY(i) }));
        const own = [...Array(rings.rows).keys()].filter(
          (i) => rings.numbers("bubble")[i] === bubbles[row] && rings.numbers("is_margin")[i] === isMargin,
        );
        expect(own.length).toBeGreaterThan(0);
        for (const i of own) {
          const [x, y] = [rings.list("x", i), rings.list("y", i)];
          for (let k = 0; k < x.length; k++) expect(isThere(corners, x[k], y[k])).toBe(true);
        }
        // Six corners for each of its sides.
        expect(corners.length).toBe(6 * own.reduce((sum, i) => sum + rings.list("x", i).length, 0));
      }
      const alpha = part<{ uniforms: { alpha: { value: number } } }>(part<Mesh>(parts.zone, "mesh"), "material");
      expect(alpha.uniforms.alpha.value).toBeCloseTo(on[row] ? 0.5 : 0.125);
      expect(part<Mesh>(parts, "floor").visible).toBe(true);
      expect(pointsOf(part<Mesh>(parts.foot, "mesh")).length).toBeGreaterThan(0);
    }
  });
});

describe("a collision", () => {
  it("is a mark on the time line, a wave on the road, and marks the vehicles from then on", async () => {
    const view = await viewOf("keep_lane");
    const hit = view.agents.filter(({ outcome }) => outcome === "COLLISION");
    expect(hit.length).toBeGreaterThan(0);
    const markers = markersOf(view.recording, view.agents);
    for (const agent of hit) {
      const own = markers.filter((each) => each.agent === agent.row && each.tone === "bad");
      expect(own.map(({ step }) => step)).toContain(agent.endStep);
      view.choose(null);
      await show(view, agent.endStep - 1);
      const before = decalsOf(overlaysOf(view).rings).length;
      await show(view, agent.endStep);
      const { now } = view;
      const place = now.agent.subarray(0, now.count).indexOf(agent.row);
      expect(place).toBeGreaterThanOrEqual(0);
      expect(now.flags[place] & COLLIDED).toBe(COLLIDED);
      const rings = decalsOf(overlaysOf(view).rings).filter((each) => near(each, [now.x[place], now.y[place]]));
      expect(decalsOf(overlaysOf(view).rings).length).toBeGreaterThan(before);
      // The wave is round, the mark has the vehicle's shape.
      expect(rings.some((each) => each[4] === each[5])).toBe(true);
      expect(rings.some((each) => each[4] > each[5])).toBe(true);
    }
  });
});
