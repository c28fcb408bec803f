/** One recording on the stage: its scene, its camera, its place, what is chosen in it. */

import { Color, Group, Scene } from "three";
import { type Agent, agentsOf, type Marker, markersOf } from "./agents";
import type { Box, Recording } from "./episode";
import { Snapshot } from "./snapshot";
import { Clock } from "./playback";
import { Bodies } from "./scene/bodies";
import { Bubbles } from "./scene/bubbles";
import { Rig } from "./scene/camera";
import { Overlays } from "./scene/overlays";
import type { Theme } from "./scene/palette";
import { Detail } from "./scene/shape";
import { type Lane, lanesOf, Roads } from "./scene/roads";
import { Sight } from "./scene/sight";

const MARGIN = 22;
const WIDEST = 420;
/** Metres of a pixel from which wheels are not drawn. */
const FAR = 0.16;
/** And from which bodies are blocks: cars are 13 pixels long. */
const AFAR = 0.35;
/** From the middle of a vehicle to the end of its lights and its shadow [m]. */
const REACH = 12;
const PATIENCE = 400;

export class View {
  readonly scene = new Scene();
  readonly rig = new Rig();
  readonly now = new Snapshot();
  readonly clock = new Clock();
  agents: Agent[] = [];
  markers: Marker[] = [];
  chosen: Agent | null = null;
  isDirty = true;
  /** Whether the camera is still to find what there is to see. */
  isUnseen = true;
  private lanes: Lane[] = [];
  private roads: Roads | null = null;
  private overlays: Overlays | null = null;
  private readonly sight: Sight;
  private bubbles: Bubbles | null = null;
  private rings = 0;
  private group: Group | null = null;
  private readonly bodies = new Bodies();
  /** Counts how often tables were taken up. */
  revision = 0;
  private version = -1;
  private refreshedAt = -Infinity;
  private followed = -1;

  constructor(
    readonly id: string,
    public title: string,
    readonly recording: Recording,
  ) {
    this.scene.matrixAutoUpdate = false;
    this.scene.background = new Color();
    recording.chunks.onArrival = () => (this.isDirty = true);
    this.sight = new Sight(recording);
    this.scene.add(...this.bodies.meshes, ...this.sight.meshes);
    this.refresh();
  }

  /** Takes up what has arrived since the last call. */
  refresh(): void {
    const { recording } = this;
    this.clock.begin = recording.firstStep * recording.dt;
    this.clock.end = recording.lastStep * recording.dt;
    this.clock.hasEnded = recording.isLive && recording.hasEnded && !recording.isComplete;
    this.isDirty = true;
    if (!this.roads && recording.map) this.build(recording.map);
    // Live tables grow with every step; what is made of them is not needed so often.
    if (
      this.version === recording.version ||
      (this.agents.length && performance.now() - this.refreshedAt < PATIENCE)
    )
      return;
    this.version = recording.version;
    this.refreshedAt = performance.now();
    this.revision++;
    this.drawBubbles();
    this.agents = agentsOf(recording);
    this.markers = markersOf(recording, this.agents);
    this.chosen =
      this.agents.find((agent) => agent.row === this.chosen?.row) ??
      this.agents.find((agent) => agent.isEgo) ??
      this.agents[0] ??
      null;
  }

  private build(map: NonNullable<Recording["map"]>): void {
    this.lanes = lanesOf(map);
    this.roads = new Roads(this.lanes);
    const group = new Group();
    this.overlays = new Overlays(this.recording, this.lanes, group);
    this.group = group;
    this.scene.add(...this.roads.meshes, ...this.overlays.meshes, group);
  }

  /** Builds the bubbles when their outlines arrive. */
  private drawBubbles(): void {
    const { rows } = this.recording.table("bubble_rings");
    if (!this.group || rows === this.rings) return;
    this.rings = rows;
    this.bubbles?.dispose();
    this.bubbles = new Bubbles(this.recording, this.group);
  }

  /** Whether all that has arrived is taken up. */
  get isCurrent(): boolean {
    return this.version === this.recording.version;
  }

  get step(): number {
    return this.clock.t / this.recording.dt;
  }

  choose(agent: Agent | null): void {
    this.chosen = agent;
    this.isDirty = true;
  }

  /** The rectangle where the agents drive, or the map where there are none. */
  region(): Box {
    const [bx0, by0, bx1, by1] = this.recording.map?.bounds ?? [0, 0, 100, 100];
    const { reach } = this.recording;
    if (reach.x0 > reach.x1) return { x0: bx0, y0: by0, x1: bx1, y1: by1 };
    const box = { x0: Infinity, y0: Infinity, x1: -Infinity, y1: -Infinity };
    const add = (x: number, y: number) => {
      box.x0 = Math.min(box.x0, x - MARGIN);
      box.y0 = Math.min(box.y0, y - MARGIN);
      box.x1 = Math.max(box.x1, x + MARGIN);
      box.y1 = Math.max(box.y1, y + MARGIN);
    };
    add(reach.x0, reach.y0);
    add(reach.x1, reach.y1);
    for (const { goal } of this.agents) if (goal) add(goal.x, goal.y);
    const clipped = {
      x0: Math.max(box.x0, bx0 - 8),
      y0: Math.max(box.y0, by0 - 8),
      x1: Math.min(box.x1, bx1 + 8),
      y1: Math.min(box.y1, by1 + 8),
    };
    const span = Math.max(clipped.x1 - clipped.x0, clipped.y1 - clipped.y0);
    return span < WIDEST && span > 0 ? clipped : { x0: bx0, y0: by0, x1: bx1, y1: by1 };
  }

  /** Brings the scene to the clock's time; `seconds` is the real time since the last picture. */
  update(seconds: number, theme: Theme): void {
    const { recording, rig, now } = this;
    const step = Math.min(recording.lastStep, Math.max(recording.firstStep, this.step));
    const isThere = recording.sample(step, now);
    this.follow(seconds);
    rig.update(seconds);
    (this.scene.background as Color).setRGB(...theme.ground);
    const metres = rig.pixel * rig.aim.distance;
    const afar = rig.aim.tilt < 0.1 ? Detail.Tops : Detail.Block;
    const detail = metres > AFAR ? afar : metres > FAR ? Detail.Coarse : Detail.All;
    for (let i = 0; i < now.count; i++) now.isSeen[i] = rig.sees(now.x[i], now.y[i], REACH) ? 1 : 0;
    this.roads?.update(theme, rig.pixel, metres);
    this.bubbles?.update(step, theme, rig.pixel);
    this.overlays?.update(now, this.agents, this.chosen, step, theme, rig.pixel, metres);
    this.sight.update(now, this.chosen, step, theme, rig.pixel);
    this.bodies.update(now, recording.vehicles, theme, this.clock.t, detail);
    this.isDirty = !isThere;
  }

  private follow(seconds: number): void {
    const place = this.chosen ? now_place(this.now, this.chosen.row) : -1;
    if (place < 0 || this.rig.mode !== "follow") {
      if (this.rig.mode !== "follow") this.followed = -1;
      return;
    }
    const isNew = this.followed !== this.now.number[place];
    this.followed = this.now.number[place];
    const lag = this.clock.isPlaying ? 1 - Math.exp(-seconds * Math.max(1, this.clock.speed) * 3) : 1;
    this.rig.track(this.now.x[place], this.now.y[place], this.now.heading[place], isNew, lag);
  }

  /** The vehicle nearest to a point on the ground, if it is close; the place in `now`. */
  pick(x: number, y: number): number {
    let best = -1;
    let least = Math.max(3, 14 * this.rig.pixel * this.rig.aim.distance);
    for (let i = 0; i < this.now.count; i++) {
      const far = Math.hypot(this.now.x[i] - x, this.now.y[i] - y) - (this.now.agent[i] >= 0 ? 1 : 0);
      if (far < least) [best, least] = [i, far];
    }
    return best;
  }

  dispose(): void {
    this.bodies.dispose();
    this.roads?.dispose();
    this.overlays?.dispose();
    this.sight.dispose();
    this.bubbles?.dispose();
  }
}

function now_place(now: Snapshot, agent: number): number {
  for (let i = 0; i < now.count; i++) if (now.agent[i] === agent) return i;
  return -1;
}
