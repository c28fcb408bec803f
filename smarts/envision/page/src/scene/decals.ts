/** Soft rounded shapes on the ground: shadows, glows, lights, goals, hits, the ring of the chosen vehicle. */

import {
  BufferAttribute,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  Mesh,
  RawShaderMaterial,
} from "three";
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
  private readonly geometry = new InstancedBufferGeometry();
  private readonly material = new RawShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    transparent: true,
    depthWrite: false,
  });
  private capacity = 0;
  private count = 0;
  private arrays: Record<"pose" | "shape" | "fill" | "edge", Float32Array> = {
    pose: EMPTY,
    shape: EMPTY,
    fill: EMPTY,
    edge: EMPTY,
  };

  constructor(order: number, z: number) {
    const quad = [
      [-1, -1],
      [1, -1],
      [1, 1],
      [-1, -1],
      [1, 1],
      [-1, 1],
    ].flatMap(([x, y]) => [x, y, z]);
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(quad), 3));
    this.grow(32);
    this.mesh = new Mesh(this.geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = order;
  }

  private grow(capacity: number): void {
    if (this.capacity) this.geometry.dispose();
    this.capacity = capacity;
    for (const name of ["pose", "shape", "fill", "edge"] as const) {
      const values = new Float32Array(4 * capacity);
      values.set(this.arrays[name]);
      this.arrays[name] = values;
      this.geometry.setAttribute(name, new InstancedBufferAttribute(values, 4).setUsage(DynamicDrawUsage));
    }
  }

  begin(): void {
    this.count = 0;
  }

  add(decal: Decal): void {
    if (this.count === this.capacity) this.grow(2 * this.capacity);
    const at = 4 * this.count++;
    const { pose, shape, fill, edge } = this.arrays;
    const colour = decal.edge ?? decal.fill;
    set(pose, at, decal.x, decal.y, decal.angle ?? 0, decal.edgeWidth ?? 0);
    set(shape, at, decal.half[0], decal.half[1], decal.corner ?? 0, decal.soft ?? 0.05);
    set(fill, at, decal.fill[0], decal.fill[1], decal.fill[2], decal.alpha);
    set(edge, at, colour[0], colour[1], colour[2], decal.edgeAlpha ?? 0);
  }

  end(): void {
    this.geometry.instanceCount = this.count;
    this.mesh.visible = this.count > 0;
    for (const name of ["pose", "shape", "fill", "edge"]) {
      const attribute = this.geometry.getAttribute(name) as InstancedBufferAttribute;
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, 4 * this.count);
      attribute.needsUpdate = true;
    }
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}

const EMPTY = new Float32Array(0);

function set(array: Float32Array, at: number, a: number, b: number, c: number, d: number): void {
  array[at] = a;
  array[at + 1] = b;
  array[at + 2] = c;
  array[at + 3] = d;
}
