/** Soft rounded shapes on the ground: shadows, glows, lights, goals, hits, the ring of the chosen vehicle. */

import { Mesh, RawShaderMaterial } from "three";
import { Copies } from "./copies";
import type { Rgb } from "./palette";

const VERTEX = `
precision highp float;
uniform mat4 viewMatrix, projectionMatrix;
attribute vec3 position;
attribute vec4 pose, shape, fill, edge;
varying vec2 at;
varying vec4 form, inside, rim;
varying float line;
void main() {
  float reach = abs(shape.w) + pose.w;
  at = position.xy * (shape.xy + reach);
  form = shape; inside = fill; rim = edge; line = pose.w;
  float s = sin(pose.z), k = cos(pose.z);
  gl_Position = projectionMatrix * viewMatrix * vec4(mat2(k, s, -s, k) * at + pose.xy, position.z, 1.0);
}`;

const FRAGMENT = `
precision highp float;
varying vec2 at;
varying vec4 form, inside, rim;
varying float line;
void main() {
  vec2 q = abs(at) - form.xy + form.z;
  float d = length(max(q, 0.0)) + min(max(q.x, q.y), 0.0) - form.z;
  float soft = max(form.w, 0.03);
  float fill = inside.a * (1.0 - smoothstep(-soft, soft, d));
  float edge = line > 0.0 ? rim.a * (1.0 - smoothstep(line * 0.5, line * 0.5 + 0.12, abs(d))) : 0.0;
  float a = max(fill, edge);
  if (a < 0.004) discard;
  gl_FragColor = vec4(mix(inside.rgb, rim.rgb, edge / max(a, 0.001)), a);
}`;

export interface Decal {
  x: number;
  y: number;
  angle?: number;
  /** Half extents [m]. */
  half: readonly [number, number];
  corner?: number;
  /** Width of the blurred rim [m]. */
  soft?: number;
  fill: Rgb;
  alpha: number;
  edge?: Rgb;
  edgeAlpha?: number;
  edgeWidth?: number;
}

export class Decals {
  readonly mesh: Mesh;
  private readonly material = new RawShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    transparent: true,
    depthWrite: false,
  });
  private readonly copies: Copies;

  constructor(order: number, z: number) {
    const position = { values: [-1, -1, z, 1, -1, z, 1, 1, z, -1, 1, z], size: 3 };
    const square = { attributes: { position }, corners: 4, index: [0, 1, 2, 0, 2, 3] };
    this.copies = new Copies(square, { pose: 4, shape: 4, fill: 4, edge: 4 });
    this.mesh = new Mesh(this.copies.geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = order;
  }

  begin(): void {
    this.copies.begin();
  }

  add(decal: Decal): void {
    const [length, width] = decal.half;
    const { x, y, angle = 0, corner = 0, soft = 0.05, fill, alpha } = decal;
    const at = this.put(x, y, angle, length, width, corner, soft, fill, alpha);
    const colour = decal.edge ?? fill;
    const { values } = this.copies;
    values[at + 3] = decal.edgeWidth ?? 0;
    set(values, at + 12, colour[0], colour[1], colour[2], decal.edgeAlpha ?? 0);
  }

  /** Adds a shape without a rim; takes numbers, since there are many in each picture.

  Returns where its numbers begin. */
  put(
    x: number,
    y: number,
    angle: number,
    halfLength: number,
    halfWidth: number,
    corner: number,
    soft: number,
    fill: Rgb,
    alpha: number,
  ): number {
    const at = this.copies.add();
    const { values } = this.copies;
    set(values, at, x, y, angle, 0);
    set(values, at + 4, halfLength, halfWidth, corner, soft);
    set(values, at + 8, fill[0], fill[1], fill[2], alpha);
    set(values, at + 12, 0, 0, 0, 0);
    return at;
  }

  end(): void {
    this.copies.end();
    this.mesh.visible = this.copies.count > 0;
  }

  dispose(): void {
    this.copies.dispose();
    this.material.dispose();
  }
}

function set(array: Float32Array, at: number, a: number, b: number, c: number, d: number): void {
  array[at] = a;
  array[at + 1] = b;
  array[at + 2] = c;
  array[at + 3] = d;
}
