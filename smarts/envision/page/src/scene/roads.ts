/** The map as two meshes, surfaces and paint; colours are uniforms, so that a change of theme rebuilds nothing. */

import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, RawShaderMaterial } from "three";
import type { MapMessage, Numbers } from "../messages";
import { Table } from "../tables";
import { type Theme, Tone } from "./palette";

enum Kind {
  Car,
  Bus,
  Bicycle,
  Foot,
  Rail,
  Shoulder,
  Closed,
}
const KIND_TONE = [Tone.Road, Tone.Bus, Tone.Bicycle, Tone.Foot, Tone.Rail, Tone.Shoulder, Tone.Closed];
/** Surfaces later in the list cover those before. */
const ORDER = [Kind.Rail, Kind.Closed, Kind.Foot, Kind.Shoulder, Kind.Bicycle, Kind.Bus, Kind.Car];
const DASHED = 1;
const SOLID = 2;
const CENTRE = 3;
const STOP_AT_LIGHTS = 1;
const KERB = 0.28;
/** Metres of a pixel up to which dashed lines are drawn. */
const DASHES = 0.7;
/** Pieces of dashed lines in a map; the lines of larger ones are not drawn to their end. */
const MOST_PIECES = 400_000;

export interface Lane {
  /** x, y in turn [m]. */
  points: Float32Array;
  width: number;
  kind: number;
  isJunction: boolean;
  left: number;
  right: number;
  stop: number;
  hasSignal: boolean;
  edge: number;
}

export function lanesOf(map: MapMessage): Lane[] {
  const table = new Table(map.lanes);
  const column = (name: string): Numbers => table.numbers(name);
  const [start, x, y] = [column("start"), column("x"), column("y")];
  const lanes: Lane[] = [];
  for (let i = 0; i + 1 < start.length; i++) {
    const points = new Float32Array(2 * Math.max(0, start[i + 1] - start[i]));
    for (let k = 0; 2 * k < points.length; k++) {
      points[2 * k] = 0.01 * x[start[i] + k];
      points[2 * k + 1] = 0.01 * y[start[i] + k];
    }
    lanes.push({
      points,
      width: 0.01 * column("width")[i],
      kind: column("kind")[i],
      isJunction: column("junction")[i] === 1,
      left: column("left")[i],
      right: column("right")[i],
      stop: column("stop")[i],
      hasSignal: column("signal")[i] === 1,
      edge: column("edge")[i],
    });
  }
  return lanes;
}

/** Moves a line sideways, to the left by `offset` [m]; corners are mitred. */
export function shifted(points: ArrayLike<number>, offset: number): Float32Array {
  const n = points.length >> 1;
  const out = new Float32Array(2 * n);
  for (let i = 0; i < n; i++) {
    const [ax, ay] = direction(points, Math.max(0, i - 1), Math.max(1, i));
    const [bx, by] = direction(points, Math.min(i, n - 2), Math.min(i + 1, n - 1));
    let [nx, ny] = [-(ay + by), ax + bx];
    const length = Math.hypot(nx, ny) || 1;
    nx /= length;
    ny /= length;
    // The length of a mitre is bounded where a line turns back.
    const mitre = Math.min(2, 1 / Math.max(0.3, -nx * ay + ny * ax));
    out[2 * i] = points[2 * i] + offset * mitre * nx;
    out[2 * i + 1] = points[2 * i + 1] + offset * mitre * ny;
  }
  return out;
}

function direction(points: ArrayLike<number>, i: number, j: number): [number, number] {
  const [dx, dy] = [points[2 * j] - points[2 * i], points[2 * j + 1] - points[2 * i + 1]];
  const length = Math.hypot(dx, dy) || 1;
  return [dx / length, dy / length];
}

const SURFACE_VERTEX = `
precision highp float;
uniform mat4 viewMatrix, projectionMatrix;
uniform vec3 tones[14];
attribute vec3 position;
varying vec3 colour;
void main() {
  colour = tones[int(position.z + 0.5)];
  gl_Position = projectionMatrix * viewMatrix * vec4(position.xy, 0.0, 1.0);
}`;

const SURFACE_FRAGMENT = `
precision mediump float;
varying vec3 colour;
void main() { gl_FragColor = vec4(colour, 1.0); }`;

const PAINT_VERTEX = `
precision highp float;
uniform mat4 viewMatrix, projectionMatrix;
uniform vec3 tones[14];
uniform vec3 ground;
uniform float pixel;
attribute vec3 position;
attribute vec3 side;
varying vec4 colour;
void main() {
  vec4 middle = projectionMatrix * viewMatrix * vec4(position.xy, 0.005, 1.0);
  float thin = 0.5 * pixel * middle.w;
  float width = max(side.z, min(thin, 0.5));
  colour = vec4(tones[int(position.z + 0.5)], clamp(1.5 * side.z / thin, 0.0, 1.0));
  gl_Position = projectionMatrix * viewMatrix * vec4(position.xy + side.xy * width, 0.005, 1.0);
}`;

const PAINT_FRAGMENT = `
precision mediump float;
varying vec4 colour;
void main() { gl_FragColor = colour; }`;

/** Collects triangles; z carries the tone. */
class Strip {
  readonly position: number[] = [];
  readonly index: number[] = [];

  between(left: ArrayLike<number>, right: ArrayLike<number>, tone: Tone): void {
    const base = this.position.length / 3;
    for (let i = 0; i < left.length >> 1; i++) {
      this.position.push(left[2 * i], left[2 * i + 1], tone, right[2 * i], right[2 * i + 1], tone);
      if (i)
        this.index.push(
          base + 2 * i - 2,
          base + 2 * i - 1,
          base + 2 * i,
          base + 2 * i,
          base + 2 * i - 1,
          base + 2 * i + 1,
        );
    }
  }
}

export class Roads {
  readonly meshes: Mesh[];
  private readonly materials: RawShaderMaterial[];

  private readonly dashes: Mesh;
  private painted: Theme | null = null;

  constructor(lanes: readonly Lane[]) {
    const [surface, surfaceMaterial] = surfaces(lanes);
    const [solid, dashed] = paintsOf(lanes);
    const paintMaterial = paintMaterialOf();
    this.dashes = meshOf(dashed, paintMaterial);
    this.meshes = [surface, meshOf(solid, paintMaterial), this.dashes];
    this.materials = [surfaceMaterial, paintMaterial];
  }

  /** Paints in the colours of a theme; `metres` is the size of a pixel at the middle of the picture. */
  update(theme: Theme, pixel: number, metres: number): void {
    // From afar dashed lines are fainter than can be seen, and there are very many.
    this.dashes.visible = metres < DASHES;
    for (const { uniforms } of this.materials) {
      if (theme !== this.painted) uniforms.tones.value = theme.tones.flat();
      if (uniforms.pixel) uniforms.pixel.value = pixel;
    }
    this.painted = theme;
  }

  dispose(): void {
    for (const mesh of this.meshes) mesh.geometry.dispose();
    for (const material of this.materials) material.dispose();
  }
}

function surfaces(lanes: readonly Lane[]): [Mesh, RawShaderMaterial] {
  const strip = new Strip();
  const drawn = lanes.filter((lane) => lane.points.length >= 4);
  const isCrossing = (lane: Lane) => lane.kind === Kind.Foot && lane.isJunction;
  const add = (lane: Lane, wider: number, tone: Tone) =>
    strip.between(
      shifted(lane.points, lane.width / 2 + wider),
      shifted(lane.points, -lane.width / 2 - wider),
      tone,
    );
  for (const lane of drawn)
    if (lane.kind !== Kind.Rail && lane.kind !== Kind.Closed && !isCrossing(lane)) add(lane, KERB, Tone.Kerb);
  for (const kind of ORDER)
    for (const lane of drawn)
      if (lane.kind === kind && !isCrossing(lane))
        add(
          lane,
          0.01,
          kind === Kind.Car && lane.isJunction ? Tone.Junction : (KIND_TONE[kind] ?? Tone.Road),
        );
  for (const lane of drawn) if (isCrossing(lane)) zebra(lane, strip);
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(strip.position), 3));
  geometry.setIndex(new BufferAttribute(new Uint32Array(strip.index), 1));
  const material = new RawShaderMaterial({
    vertexShader: SURFACE_VERTEX,
    fragmentShader: SURFACE_FRAGMENT,
    depthTest: false,
    depthWrite: false,
    side: DoubleSide,
    uniforms: { tones: { value: [] } },
  });
  return [flat(geometry, material, 0), material];
}

const MOST_STRIPES = 500;

/** Stripes along the traffic, as on a pedestrian crossing. */
function zebra(lane: Lane, strip: Strip): void {
  walk(lane.points, 0.55, 0.5, MOST_STRIPES, (piece) =>
    strip.between(shifted(piece, lane.width / 2 - 0.1), shifted(piece, -lane.width / 2 + 0.1), Tone.Zebra),
  );
}

/** Calls `take` with at most `most` pieces of a dashed line; returns how many there were. */
function walk(
  points: ArrayLike<number>,
  dash: number,
  gap: number,
  most: number,
  take: (piece: number[]) => void,
): number {
  let pieces = 0;
  let piece: number[] = [points[0], points[1]];
  let isDash = true;
  let left = dash;
  for (let i = 0; i + 1 < points.length >> 1; i++) {
    let [x, y] = [points[2 * i], points[2 * i + 1]];
    const [dx, dy] = direction(points, i, i + 1);
    let rest = Math.hypot(points[2 * i + 2] - x, points[2 * i + 3] - y);
    while (rest >= left) {
      if (pieces >= most) return pieces;
      x += dx * left;
      y += dy * left;
      rest -= left;
      piece.push(x, y);
      if (isDash) take(piece);
      pieces++;
      isDash = !isDash;
      left = isDash ? dash : gap;
      piece = [x, y];
    }
    left -= rest;
    if (rest > 1e-4) piece.push(points[2 * i + 2], points[2 * i + 3]);
  }
  if (isDash && piece.length >= 4) take(piece);
  return pieces;
}

class Paint {
  /** Pieces of dashed lines that may still be drawn. */
  pieces = MOST_PIECES;
  readonly position: number[] = [];
  readonly side: number[] = [];
  readonly index: number[] = [];

  line(points: ArrayLike<number>, half: number, tone: Tone): void {
    const n = points.length >> 1;
    if (n < 2) return;
    const base = this.position.length / 3;
    for (let i = 0; i < n; i++) {
      const [dx, dy] = direction(points, Math.max(0, i - 1), Math.min(n - 1, i + 1));
      for (const sign of [-1, 1]) {
        this.position.push(points[2 * i], points[2 * i + 1], tone);
        this.side.push(-sign * dy, sign * dx, half);
      }
      if (i)
        this.index.push(
          base + 2 * i - 2,
          base + 2 * i - 1,
          base + 2 * i,
          base + 2 * i,
          base + 2 * i - 1,
          base + 2 * i + 1,
        );
    }
  }
}

/** Returns the solid lines and the dashed ones. */
function paintsOf(lanes: readonly Lane[]): [Paint, Paint] {
  const [paint, dashed] = [new Paint(), new Paint()];
  for (const lane of lanes) {
    if (lane.points.length < 4 || lane.isJunction) continue;
    for (const [side, code] of [
      [1, lane.left],
      [-1, lane.right],
    ] as const) {
      // Two lanes share a dashed line: the lane to its right paints it.
      if (code === DASHED && side > 0)
        dashed.pieces -= walk(shifted(lane.points, lane.width / 2), 3, 4.5, dashed.pieces, (piece) =>
          dashed.line(piece, 0.075, Tone.White),
        );
      if (code === SOLID) paint.line(shifted(lane.points, side * (lane.width / 2 - 0.12)), 0.06, Tone.Edge);
      if (code === CENTRE)
        paint.line(shifted(lane.points, side * (lane.width / 2 - 0.12)), 0.07, Tone.Yellow);
    }
    if (lane.stop) stopLine(lane, paint);
  }
  return [paint, dashed];
}

function meshOf(paint: Paint, material: RawShaderMaterial): Mesh {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(paint.position), 3));
  geometry.setAttribute("side", new BufferAttribute(new Float32Array(paint.side), 3));
  geometry.setIndex(new BufferAttribute(new Uint32Array(paint.index), 1));
  return flat(geometry, material, 1);
}

function paintMaterialOf(): RawShaderMaterial {
  return new RawShaderMaterial({
    vertexShader: PAINT_VERTEX,
    fragmentShader: PAINT_FRAGMENT,
    depthWrite: false,
    side: DoubleSide,
    transparent: true,
    uniforms: { tones: { value: [] }, pixel: { value: 0.001 } },
  });
}

function stopLine(lane: Lane, paint: Paint): void {
  const n = lane.points.length >> 1;
  const [dx, dy] = direction(lane.points, n - 2, n - 1);
  const half = lane.width / 2 - 0.2;
  const [x, y] = [lane.points[2 * n - 2] - 0.35 * dx, lane.points[2 * n - 1] - 0.35 * dy];
  const across = [x - half * dy, y + half * dx, x + half * dy, y - half * dx];
  if (lane.stop === STOP_AT_LIGHTS) paint.line(across, 0.2, Tone.Stop);
  else walk(across, 0.5, 0.35, MOST_STRIPES, (piece) => paint.line(piece, 0.2, Tone.Stop));
}

function flat(geometry: BufferGeometry, material: RawShaderMaterial, order: number): Mesh {
  const mesh = new Mesh(geometry, material);
  mesh.frustumCulled = false;
  mesh.renderOrder = order;
  return mesh;
}
