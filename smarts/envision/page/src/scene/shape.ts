/** A body as triangles, built from lofted rings. Lengths are fractions of length, width and height. */

import type { Stencil } from "./copies";

export enum Part {
  Body,
  Glass,
  Tyre,
  HeadLight,
  TailLight,
  LeftIndicator,
  RightIndicator,
  Cargo,
  Hub,
}

export interface Arrays {
  position: Float32Array;
  normal: Float32Array;
  /** x, y of the axis about which a vertex steers, and 1 if it does. */
  pivot: Float32Array;
  part: Float32Array;
  index: Uint16Array;
}

/** A rounded rectangle at height z: from x0 to x1, of a half width, with corners of a radius in metres. */
type Ring = [z: number, x0: number, x1: number, half: number, radius: number];

/** How much of a body is drawn. */
export enum Detail {
  All,
  /** Without wheels. */
  Coarse,
  /** A block with its lights. */
  Block,
  /** What of the block is seen from above. */
  Tops,
}

const UP = [0, 0, 1];
const CORNER = 2;
const SPOKES = 10;

export class Shape {
  readonly arrays: Arrays;
  /** From corner to corner of `index`: what is drawn at each distance, by `Detail`. */
  readonly ranges: readonly [number, number][];
  private readonly details: (() => void)[] = [];
  private readonly position: number[] = [];
  private readonly normal: number[] = [];
  private readonly pivot: number[] = [];
  private readonly part: number[] = [];
  private readonly index: number[] = [];
  private readonly known = new Map<string, number>();

  constructor(
    readonly length: number,
    readonly width: number,
    readonly height: number,
    build: (shape: Shape) => void,
  ) {
    this.tops();
    const tops = this.index.length;
    this.box(Part.Body, [-0.5, 0.5], [-0.49, 0.49], [0.1, this.isTall ? 0.98 : 0.6]);
    const block = this.index.length;
    build(this);
    const coarse = this.index.length;
    for (const add of this.details) add();
    this.turnOutwards();
    this.ranges = [
      [block, Infinity],
      [block, coarse - block],
      [0, block],
      [0, tops],
    ];
    this.arrays = {
      position: new Float32Array(this.position),
      normal: new Float32Array(this.normal),
      pivot: new Float32Array(this.pivot),
      part: new Float32Array(this.part),
      index: new Uint16Array(this.index),
    };
  }

  /** What is drawn of it from afar, by itself. */
  stencil(detail: Detail.Block | Detail.Tops): Stencil {
    const [begin, count] = this.ranges[detail];
    const index = this.arrays.index.subarray(begin, begin + count);
    const corners = Math.max(...index) + 1;
    const part = (name: "position" | "normal" | "pivot" | "part", size: number) => ({
      values: this.arrays[name].subarray(0, size * corners),
      size,
    });
    const attributes = {
      position: part("position", 3),
      normal: part("normal", 3),
      pivot: part("pivot", 3),
      part: part("part", 1),
    };
    return { attributes, corners, index };
  }

  private get isTall(): boolean {
    return this.height > 2;
  }

  /** Adds what is seen from above of vehicles that are a few pixels long. */
  private tops(): void {
    const flat = (part: Part, x0: number, x1: number, y: number, z: number) =>
      this.quad([x0, -y, z], [x1, -y, z], [x1, y, z], [x0, y, z], UP, part);
    flat(Part.Body, -0.5, 0.5, 0.49, this.isTall ? 0.98 : 0.6);
    flat(Part.TailLight, -0.52, -0.43, 0.45, this.isTall ? 0.985 : 0.62);
    if (this.isTall) return;
    flat(Part.Glass, -0.37, 0.2, 0.42, 0.9);
    flat(Part.Body, -0.29, 0.1, 0.4, 0.95);
  }

  /** Turns all triangles so that their corners go round counter-clockwise seen from outside. */
  private turnOutwards(): void {
    const { position, normal, index } = this;
    const at = (list: number[], i: number) => list.slice(3 * i, 3 * i + 3);
    const metres = (i: number) => {
      const [x, y, z] = at(position, i);
      return [x * this.length, y * this.width, z * this.height];
    };
    for (let i = 0; i < index.length; i += 3) {
      const [a, b, c] = index.slice(i, i + 3);
      const face = cross(minus(metres(b), metres(a)), minus(metres(c), metres(a)));
      const out = [a, b, c].map((each) => at(normal, each));
      const facing = out.reduce((sum, n) => sum + n[0] * face[0] + n[1] * face[1] + n[2] * face[2], 0);
      if (facing < 0) [index[i + 1], index[i + 2]] = [c, b];
    }
  }

  /** Adds the sides between rings, each with its part, and the top of the last one. */
  loft(rings: Ring[], parts: Part[], top: Part, steers?: [number, number]): this {
    const outlines = rings.map((ring) => this.outline(ring));
    for (let band = 0; band + 1 < rings.length; band++)
      this.band(outlines[band], outlines[band + 1], parts[band], steers);
    this.cap(outlines[outlines.length - 1], top, steers);
    return this;
  }

  /** Adds a box without a floor, from a corner to the other. */
  box(
    part: Part,
    x: [number, number],
    y: [number, number],
    z: [number, number],
    steers?: [number, number],
  ): this {
    const corners = [
      [x[0], y[0]],
      [x[1], y[0]],
      [x[1], y[1]],
      [x[0], y[1]],
    ];
    const normals = [
      [0, -1, 0],
      [1, 0, 0],
      [0, 1, 0],
      [-1, 0, 0],
    ];
    corners.forEach((a, i) => {
      const b = corners[(i + 1) % 4];
      this.quad([...a, z[0]], [...b, z[0]], [...b, z[1]], [...a, z[1]], normals[i], part, steers);
    });
    const [a, b, c, d] = corners.map((corner) => [...corner, z[1]]);
    this.quad(a, b, c, d, [0, 0, 1], part, steers);
    return this;
  }

  private quad(
    a: number[],
    b: number[],
    c: number[],
    d: number[],
    normal: number[],
    part: Part,
    steers?: [number, number],
  ): void {
    for (const point of [a, b, c, a, c, d]) this.vertex(point, normal, part, steers);
  }

  /** Adds wheels at distances from the middle; those before it steer. */
  wheels(places: number[], length: number, top: number, outside = 0.515): this {
    for (const x of places)
      for (const side of [-1, 1]) {
        const y: [number, number] = side > 0 ? [outside - 0.13, outside] : [-outside, -outside + 0.13];
        this.details.push(() => this.wheel(x, length / 2, y, top, x > 0 ? [x, side * (outside - 0.06)] : undefined));
      }
    return this;
  }

  /** Adds a wheel that stands on the ground: a tyre with a lighter disc on both sides. */
  private wheel(
    x: number,
    radius: number,
    [y0, y1]: [number, number],
    top: number,
    steers?: [number, number],
  ): void {
    const rim = (angle: number, part: number, y: number) => [
      x + part * radius * Math.cos(angle),
      y,
      (top / 2) * (1 + part * Math.sin(angle)),
    ];
    for (let i = 0; i < SPOKES; i++) {
      const [a, b] = [(2 * Math.PI * i) / SPOKES, (2 * Math.PI * (i + 1)) / SPOKES];
      const out = (angle: number) => [Math.cos(angle), 0, Math.sin(angle)];
      const tread: [number[], number[]][] = [
        [rim(a, 1, y0), out(a)],
        [rim(b, 1, y0), out(b)],
        [rim(b, 1, y1), out(b)],
        [rim(a, 1, y0), out(a)],
        [rim(b, 1, y1), out(b)],
        [rim(a, 1, y1), out(a)],
      ];
      for (const [point, normal] of tread) this.vertex(point, normal, Part.Tyre, steers);
      // The side that faces the vehicle is never seen.
      const sign = y0 + y1 > 0 ? 1 : -1;
      const face = sign > 0 ? y1 : y0;
      for (const [size, part] of [
        [1, Part.Tyre],
        [0.58, Part.Hub],
      ] as const) {
        const y = face + sign * (1 - size) * 0.004;
        for (const point of [[x, y, top / 2], rim(a, size, y), rim(b, size, y)])
          this.vertex(point, [0, sign, 0], part, steers);
      }
    }
  }

  /** Adds head lights, tail lights and indicators at the corners. */
  lights(z: [number, number], front = 0.5, rear = -0.5, half = 0.47): this {
    const deep = 0.16 / this.length;
    for (const side of [-1, 1] as const) {
      const at = (from: number, to: number): [number, number] =>
        side > 0 ? [from * half, to * half] : [-to * half, -from * half];
      const indicator = side > 0 ? Part.LeftIndicator : Part.RightIndicator;
      this.box(Part.HeadLight, [front - deep, front + 0.003], at(0.5, 0.84), z);
      this.box(indicator, [front - 2 * deep, front], at(0.86, 1.01), z);
      this.box(Part.TailLight, [rear - 0.004, rear + deep], at(0.4, 0.84), z);
      this.box(indicator, [rear, rear + 2 * deep], at(0.86, 1.01), z);
    }
    return this;
  }

  private outline([z, x0, x1, half, radius]: Ring): number[][] {
    const [rx, ry] = [Math.min(radius / this.length, (x1 - x0) / 2), Math.min(radius / this.width, half)];
    const points: number[][] = [];
    const corners = [
      [x1 - rx, half - ry, 0],
      [x0 + rx, half - ry, 1],
      [x0 + rx, -half + ry, 2],
      [x1 - rx, -half + ry, 3],
    ];
    for (const [x, y, quarter] of corners)
      for (let i = 0; i <= CORNER; i++) {
        const angle = ((quarter + i / CORNER) * Math.PI) / 2;
        points.push([x + rx * Math.cos(angle), y + ry * Math.sin(angle), z]);
      }
    return points;
  }

  private band(low: number[][], high: number[][], part: Part, steers?: [number, number]): void {
    const n = low.length;
    const metres = (p: number[]) => [p[0] * this.length, p[1] * this.width, p[2] * this.height];
    const normals = low.map((_, i) => {
      const [a, b] = [metres(low[(i + n - 1) % n]), metres(low[(i + 1) % n])];
      const [p, q] = [metres(low[i]), metres(high[i])];
      return unit(cross(minus(b, a), minus(q, p)));
    });
    for (let i = 0; i < n; i++) {
      const j = (i + 1) % n;
      const corners: [number[], number[]][] = [
        [low[i], normals[i]],
        [low[j], normals[j]],
        [high[j], normals[j]],
        [low[i], normals[i]],
        [high[j], normals[j]],
        [high[i], normals[i]],
      ];
      for (const [point, normal] of corners) this.vertex(point, normal, part, steers);
    }
  }

  private cap(outline: number[][], part: Part, steers?: [number, number]): void {
    for (let i = 1; i + 1 < outline.length; i++)
      for (const point of [outline[0], outline[i], outline[i + 1]])
        this.vertex(point, [0, 0, 1], part, steers);
  }

  /** Adds a corner of a triangle; corners that are alike are one vertex. */
  private vertex(point: number[], normal: number[], part: Part, steers?: [number, number]): void {
    const pivot = [steers?.[0] ?? 0, steers?.[1] ?? 0, steers ? 1 : 0];
    const key = [...point, ...normal, ...pivot, part].map((value) => value.toFixed(4)).join();
    let place = this.known.get(key);
    if (place === undefined) {
      place = this.part.length;
      this.known.set(key, place);
      this.position.push(...point);
      this.normal.push(...normal);
      this.pivot.push(...pivot);
      this.part.push(part);
    }
    this.index.push(place);
  }
}

const minus = (a: number[], b: number[]) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const cross = (a: number[], b: number[]) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
const unit = (a: number[]) => {
  const length = Math.hypot(a[0], a[1], a[2]) || 1;
  return [a[0] / length, a[1] / length, a[2] / length];
};
