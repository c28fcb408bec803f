/** What is drawn over the road: lights, trails, the chosen route, goals, hits, bubbles. */

import type { Group, Mesh } from "three";
import type { Agent } from "../agents";
import type { Recording } from "../episode";
import { COLLIDED, Driver, type Snapshot } from "../snapshot";
import { Decals } from "./decals";
import { Lines } from "./lines";
import { CAUTION_LIGHT, GO_LIGHT, type Rgb, STOP_LIGHT, type Theme } from "./palette";
import type { Lane } from "./roads";
import { circle, Wall } from "./walls";

const TRAIL = 40;
const BRAKE = 1 << 3;
const BLACK: Rgb = [0, 0, 0];
/** Metres of a pixel up to which vehicles have shadows. */
const SHADOWS = 0.4;
const HIT_SECONDS = 2.5;
const LIGHTS: readonly (Rgb | null)[] = [null, STOP_LIGHT, CAUTION_LIGHT, GO_LIGHT];

/** A light at the beginning of a lane into a junction. */
interface Light {
  lane: number;
  x: number;
  y: number;
  angle: number;
  half: number;
}

/** Places lights; lanes that begin at the same place share its width, from left to right. */
export function lightsOf(lanes: readonly Lane[]): Light[] {
  const groups = new Map<string, number[]>();
  lanes.forEach((lane, i) => {
    if (!lane.hasSignal || lane.points.length < 4) return;
    const key = `${Math.round(2 * lane.points[0])},${Math.round(2 * lane.points[1])}`;
    groups.set(key, [...(groups.get(key) ?? []), i]);
  });
  const lights: Light[] = [];
  for (const members of groups.values()) {
    const first = lanes[members[0]];
    const angle = Math.atan2(first.points[3] - first.points[1], first.points[2] - first.points[0]);
    const bearing = (i: number) => {
      const { points } = lanes[i];
      const a =
        Math.atan2(points[points.length - 1] - points[1], points[points.length - 2] - points[0]) - angle;
      return Math.atan2(Math.sin(a), Math.cos(a));
    };
    members.sort((a, b) => bearing(b) - bearing(a));
    const width = (first.width - 0.5) / members.length;
    members.forEach((lane, i) => {
      const offset = (first.width - 0.5) / 2 - width * (i + 0.5);
      const [x, y] = [first.points[0] + 0.55 * Math.cos(angle), first.points[1] + 0.55 * Math.sin(angle)];
      lights.push({
        lane,
        x: x - offset * Math.sin(angle),
        y: y + offset * Math.cos(angle),
        angle,
        half: width / 2 - 0.12,
      });
    });
  }
  return lights;
}

export class Overlays {
  readonly meshes: Mesh[];
  private readonly under = new Decals(2, 0.02);
  private readonly shadows = new Decals(8, 0.02);
  private readonly route = new Lines(3, 1.5);
  private readonly trails = new Lines(4);
  private readonly rings = new Decals(9, 0.05);
  private readonly lights: Light[];
  private readonly goals = new Map<number, Wall>();
  private readonly trail: number[] = [];
  private routeOf = "";

  constructor(
    private readonly recording: Recording,
    private readonly lanes: readonly Lane[],
    private readonly group: Group,
  ) {
    this.lights = lightsOf(lanes);
    this.meshes = [this.under.mesh, this.route.mesh, this.trails.mesh, this.shadows.mesh, this.rings.mesh];
  }

  update(
    now: Snapshot,
    agents: readonly Agent[],
    chosen: Agent | null,
    step: number,
    theme: Theme,
    pixel: number,
    metres: number,
  ): void {
    this.route.material.uniforms.pixel.value = pixel;
    this.trails.material.uniforms.pixel.value = pixel;
    this.drawGround(now, step, theme, metres);
    this.drawRoute(chosen, theme);
    this.drawTrails(now, step, theme);
    this.drawRings(now, agents, chosen, step, theme);
    this.placeGoals(agents, chosen, step, theme);
  }

  /** Draws lights, shadows and the glow of brakes; `metres` is the size of a pixel. */
  private drawGround(now: Snapshot, step: number, theme: Theme, metres: number): void {
    const { under, shadows } = this;
    under.begin();
    const signals = this.recording.table("signals");
    const index = this.recording.index("signals", "lane");
    for (const light of this.lights) {
      const row = index.at(light.lane, step);
      const colour = row < 0 ? null : LIGHTS[signals.numbers("signal")[row]];
      if (!colour) continue;
      under.add({ ...light, half: [1.1, light.half + 0.7], corner: 1, soft: 1.1, fill: colour, alpha: 0.3 });
      under.add({ ...light, half: [0.26, light.half], corner: 0.25, soft: 0.06, fill: colour, alpha: 1 });
    }
    under.end();
    shadows.begin();
    // From afar a shadow is less than a pixel wide.
    const hasShadows = metres < SHADOWS;
    for (let i = 0; i < now.count; i++) {
      if (!now.isSeen[i] || !(hasShadows || now.flags[i] & BRAKE)) continue;
      const vehicle = this.recording.vehicles[now.number[i]];
      const [length, width] = [vehicle?.length ?? 4.5, vehicle?.width ?? 1.8];
      const [x, y, angle] = [now.x[i], now.y[i], now.heading[i]];
      if (hasShadows) shadows.put(x + 0.18, y - 0.16, angle, length / 2, width / 2, 0.5, 0.55, BLACK, theme.shadow);
      if (!(now.flags[i] & BRAKE)) continue;
      const back = length / 2 + 0.45;
      const [bx, by] = [x - back * Math.cos(angle), y - back * Math.sin(angle)];
      shadows.put(bx, by, angle, 0.5, width / 2, 0.4, 0.9, STOP_LIGHT, 0.42);
    }
    shadows.end();
  }

  private drawTrails(now: Snapshot, step: number, theme: Theme): void {
    this.trails.begin();
    for (let i = 0; i < now.count; i++) {
      const driver = now.driver[i] as Driver;
      if (now.agent[i] < 0 || driver === Driver.Traffic) continue;
      this.recording.trail(now.number[i], step, TRAIL, this.trail);
      this.trail.push(now.x[i], now.y[i]);
      this.trails.ribbon(this.trail, 0.32, theme.drivers[driver], (part) => 0.75 * part * part);
    }
    this.trails.end();
  }

  private drawRings(
    now: Snapshot,
    agents: readonly Agent[],
    chosen: Agent | null,
    step: number,
    theme: Theme,
  ): void {
    const { rings } = this;
    rings.begin();
    for (let i = 0; i < now.count; i++) {
      const vehicle = this.recording.vehicles[now.number[i]];
      const half = [(vehicle?.length ?? 4.5) / 2 + 0.75, (vehicle?.width ?? 1.8) / 2 + 0.75] as const;
      const place = { x: now.x[i], y: now.y[i], angle: now.heading[i], half, corner: 1.1, soft: 0.3 };
      if (now.flags[i] & COLLIDED)
        rings.add({
          ...place,
          fill: theme.hit,
          alpha: 0.16,
          edge: theme.hit,
          edgeAlpha: 0.9,
          edgeWidth: 0.16,
        });
      else if (chosen && now.agent[i] === chosen.row) {
        const colour = theme.drivers[now.driver[i] as Driver];
        rings.add({ ...place, fill: colour, alpha: 0.1, edge: colour, edgeAlpha: 0.95, edgeWidth: 0.2 });
      }
    }
    for (const agent of agents) this.drawHit(agent, now, step, theme);
    rings.end();
  }

  /** Draws waves about the place of a collision for a while after it. */
  private drawHit(agent: Agent, now: Snapshot, step: number, theme: Theme): void {
    const since = (step - agent.endStep) * this.recording.dt;
    if (agent.outcome !== "COLLISION" || agent.endStep < 0 || since < 0 || since > HIT_SECONDS) return;
    const place = now.agent.indexOf(agent.row);
    if (place < 0 || place >= now.count) return;
    const [x, y] = [now.x[place], now.y[place]];
    for (const delay of [0, 0.35]) {
      const age = (since - delay) / (HIT_SECONDS - 0.5);
      if (age < 0 || age > 1) continue;
      const radius = 2.5 + 9 * Math.sqrt(age);
      this.rings.add({
        x,
        y,
        half: [radius, radius],
        corner: radius,
        soft: 0.2,
        fill: theme.hit,
        alpha: 0.1 * (1 - age),
        edge: theme.hit,
        edgeAlpha: 1 - age,
        edgeWidth: 0.5,
      });
    }
  }

  private placeGoals(agents: readonly Agent[], chosen: Agent | null, step: number, theme: Theme): void {
    for (const agent of agents) {
      if (!agent.goal) continue;
      const radius = Math.max(1.6, Math.min(8, agent.goal.radius));
      let wall = this.goals.get(agent.row);
      if (!wall) {
        this.goals.set(agent.row, (wall = new Wall([circle(radius)], 5, 0.6)));
        this.group.add(wall.mesh);
      }
      const isOver = agent.endStep >= 0 && step > agent.endStep;
      const isChosen = chosen?.row === agent.row;
      wall.mesh.visible = step >= agent.entryStep && (isChosen || !isOver);
      wall.place(
        agent.goal.x,
        agent.goal.y,
        0,
        isChosen ? theme.goal : theme.drivers[Driver.Ego],
        isChosen ? 1.3 : 0.45,
      );
    }
  }

  private drawRoute(chosen: Agent | null, theme: Theme): void {
    const key = `${chosen?.row ?? -1} ${theme.name} ${this.recording.table("routes").rows}`;
    if (key === this.routeOf) return;
    this.routeOf = key;
    this.route.begin();
    const colour = chosen?.isEgo === false ? theme.drivers[Driver.Social] : theme.route;
    for (const lane of chosen ? this.routeLanes(chosen.route) : [])
      this.route.ribbon(lane.points, lane.width * 0.36, colour, () => 0.17, 0.015);
    this.route.end();
  }

  private routeLanes(route: number): Lane[] {
    const table = this.recording.table("routes");
    const row = table.numbers("route").indexOf(route);
    if (row < 0) return [];
    const edges = Array.from(table.list("edges", row));
    const own = edges.map((edge) =>
      this.lanes.filter((lane) => lane.edge === edge && lane.points.length >= 4 && lane.kind < 2),
    );
    const between = own.slice(1).flatMap((after, i) => this.connections(own[i], after));
    return [...own.flat(), ...between];
  }

  /** Lanes of junctions that lead from one of `from` to one of `to`. */
  private connections(from: readonly Lane[], to: readonly Lane[]): Lane[] {
    const isNear = (ax: number, ay: number, bx: number, by: number) => Math.hypot(ax - bx, ay - by) < 0.6;
    const ends = from.map(({ points }) => [points[points.length - 2], points[points.length - 1]]);
    return this.lanes.filter(({ isJunction, kind, points }) => {
      if (!isJunction || kind >= 2 || points.length < 4) return false;
      const [x, y] = [points[points.length - 2], points[points.length - 1]];
      return (
        ends.some(([a, b]) => isNear(a, b, points[0], points[1])) &&
        to.some((lane) => isNear(x, y, lane.points[0], lane.points[1]))
      );
    });
  }

  dispose(): void {
    for (const part of [
      this.under,
      this.shadows,
      this.route,
      this.trails,
      this.rings,
      ...this.goals.values(),
    ])
      part.dispose();
  }
}
