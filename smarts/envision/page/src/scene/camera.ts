/** The camera: an orbit about a point on the ground, with eased changes between what it looks at. */

import { PerspectiveCamera } from "three";

export type Mode = "top" | "follow" | "free";
export interface Orbit {
  x: number;
  y: number;
  distance: number;
  /** Direction that is up on the screen, counter-clockwise from +x [rad]. */
  azimuth: number;
  /** 0 from above, to just under pi / 2 [rad]. */
  tilt: number;
}

const FIELD = 38;
const EASE = 0.16;
const STEEPEST = 1.42;
/** Asked once: to ask makes an object each time. */
const CALM = typeof matchMedia === "function" ? matchMedia("(prefers-reduced-motion: reduce)") : null;
const turn = (angle: number) => angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));

export class Rig {
  readonly camera = new PerspectiveCamera(FIELD, 1, 1, 8000);
  mode: Mode = "top";
  /** What the user sees when all has come to rest. */
  readonly aim: Orbit = { x: 0, y: 0, distance: 100, azimuth: Math.PI / 2, tilt: 0 };
  /** What is left of the last jump, which fades. */
  private readonly rest: Orbit = { x: 0, y: 0, distance: 0, azimuth: 0, tilt: 0 };
  private readonly follow = { distance: 42, azimuth: 0, tilt: 1.08 };
  private width = 1;
  private height = 1;

  get isMoving(): boolean {
    const { x, y, distance, azimuth, tilt } = this.rest;
    return (
      Math.abs(x) + Math.abs(y) + Math.abs(distance) > 0.02 || Math.abs(azimuth) + Math.abs(tilt) > 0.001
    );
  }

  /** Metres on the ground of one pixel at distance 1. */
  get pixel(): number {
    return (2 * Math.tan((FIELD * Math.PI) / 360)) / this.height;
  }

  resize(width: number, height: number): void {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
    this.camera.aspect = this.width / this.height;
  }

  /** Shows a rectangle from above. */
  fit(box: { x0: number; y0: number; x1: number; y1: number }, isEased: boolean): void {
    if (this.mode === "follow") return;
    const before = { ...this.shown };
    const half = Math.tan((FIELD * Math.PI) / 360);
    const room = 1.1;
    const aspect = this.width / this.height;
    this.aim.x = (box.x0 + box.x1) / 2;
    this.aim.y = (box.y0 + box.y1) / 2;
    this.aim.distance = Math.max(
      25,
      (room * Math.max(box.y1 - box.y0, (box.x1 - box.x0) / aspect)) / (2 * half),
    );
    this.aim.azimuth = Math.PI / 2;
    this.aim.tilt = 0;
    this.ease(isEased ? before : this.aim);
  }

  /** Changes the mode; the picture glides to the new view. */
  setMode(mode: Mode): void {
    if (mode === this.mode) return;
    const before = { ...this.shown };
    if (mode === "free" && this.aim.tilt < 0.2) this.tip();
    if (mode === "top") {
      this.aim.tilt = 0;
      this.aim.azimuth = Math.PI / 2;
      if (this.mode === "follow") this.aim.distance = 110;
    }
    this.mode = mode;
    this.ease(before);
  }

  /** Tips the view from above to one from the side. */
  tip(): void {
    this.aim.tilt = 0.98;
    this.aim.azimuth = Math.PI / 2 + 0.42;
    this.aim.distance *= 0.72;
  }

  /** Moves with a vehicle; call with each picture. */
  track(x: number, y: number, heading: number, isNew: boolean, lag: number): void {
    if (this.mode !== "follow") return;
    const before = { ...this.shown };
    const wanted = heading + this.follow.azimuth;
    this.aim.azimuth = isNew ? wanted : this.aim.azimuth + turn(wanted - this.aim.azimuth) * lag;
    // The vehicle is in the lower part of the picture: what lies ahead matters.
    const ahead = 0.17 * this.follow.distance * Math.sin(this.follow.tilt);
    this.aim.x = x + ahead * Math.cos(this.aim.azimuth);
    this.aim.y = y + ahead * Math.sin(this.aim.azimuth);
    this.aim.distance = this.follow.distance;
    this.aim.tilt = this.follow.tilt;
    if (isNew) this.ease(before);
  }

  pan(dx: number, dy: number): void {
    if (this.mode === "follow") return this.rotate(dx, dy);
    const scale = this.pixel * this.aim.distance;
    const [c, s] = [Math.cos(this.aim.azimuth), Math.sin(this.aim.azimuth)];
    const along = (dy * scale) / Math.max(0.25, Math.cos(this.aim.tilt));
    this.aim.x += -dx * scale * s + along * c;
    this.aim.y += dx * scale * c + along * s;
  }

  rotate(dx: number, dy: number): void {
    const target = this.mode === "follow" ? this.follow : this.aim;
    if (this.mode === "top") return this.pan(dx, dy);
    target.azimuth -= dx * 0.006;
    target.tilt = Math.min(STEEPEST, Math.max(0, target.tilt - dy * 0.005));
  }

  zoom(factor: number): void {
    const target = this.mode === "follow" ? this.follow : this.aim;
    target.distance = Math.min(5000, Math.max(9, target.distance * factor));
  }

  twist(angle: number): void {
    (this.mode === "follow" ? this.follow : this.aim).azimuth += angle;
  }

  private get shown(): Orbit {
    const { aim, rest } = this;
    return {
      x: aim.x + rest.x,
      y: aim.y + rest.y,
      distance: aim.distance + rest.distance,
      azimuth: aim.azimuth + rest.azimuth,
      tilt: aim.tilt + rest.tilt,
    };
  }

  private ease(from: Orbit): void {
    this.rest.x = from.x - this.aim.x;
    this.rest.y = from.y - this.aim.y;
    this.rest.distance = from.distance - this.aim.distance;
    this.rest.azimuth = turn(from.azimuth - this.aim.azimuth);
    this.rest.tilt = from.tilt - this.aim.tilt;
  }

  /** Places the camera after some seconds of real time. */
  update(seconds: number): void {
    const left = CALM?.matches ? 0 : Math.exp(-seconds / EASE);
    for (const name of ["x", "y", "distance", "azimuth", "tilt"] as const) this.rest[name] *= left;
    const { x, y, distance, azimuth, tilt } = this.shown;
    const [c, s] = [Math.cos(azimuth), Math.sin(azimuth)];
    const back = distance * Math.sin(tilt);
    this.camera.position.set(x - back * c, y - back * s, distance * Math.cos(tilt));
    this.camera.up.set(c * Math.cos(tilt), s * Math.cos(tilt), Math.sin(tilt));
    this.camera.near = distance * 0.05;
    this.camera.far = distance * 12 + 400;
    this.camera.lookAt(x, y, 0);
    this.camera.updateProjectionMatrix();
    this.camera.updateMatrixWorld();
  }

  /** Whether something of a radius about a point on the ground may be in the picture. */
  sees(x: number, y: number, radius: number): boolean {
    const e = this.camera.matrixWorldInverse.elements;
    const half = Math.tan((FIELD * Math.PI) / 360);
    const depth = -(e[2] * x + e[6] * y + e[14]);
    const [right, up] = [e[0] * x + e[4] * y + e[12], e[1] * x + e[5] * y + e[13]];
    const wide = half * this.camera.aspect;
    return (
      depth > this.camera.near - radius &&
      Math.abs(right) < depth * wide + radius * Math.hypot(1, wide) &&
      Math.abs(up) < depth * half + radius * Math.hypot(1, half)
    );
  }

  /** The point on the ground under a place in the view, 0 to 1 from the upper left. */
  ground(u: number, v: number): { x: number; y: number } | null {
    const { camera } = this;
    const half = Math.tan((FIELD * Math.PI) / 360);
    const e = camera.matrixWorld.elements;
    const [a, b] = [(2 * u - 1) * half * camera.aspect, (1 - 2 * v) * half];
    const ray = [0, 1, 2].map((i) => a * e[i] + b * e[4 + i] - e[8 + i]);
    if (ray[2] >= -1e-4) return null;
    const t = -camera.position.z / ray[2];
    return { x: camera.position.x + t * ray[0], y: camera.position.y + t * ray[1] };
  }
}
