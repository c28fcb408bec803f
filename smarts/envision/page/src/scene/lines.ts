/** Ribbons of a width in metres that stay visible from afar: markings, trails, routes. */

import {
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  DynamicDrawUsage,
  Mesh,
  RawShaderMaterial,
} from "three";
import type { Rgb } from "./palette";

const VERTEX = `
precision highp float;
uniform mat4 modelMatrix, viewMatrix, projectionMatrix;
uniform float pixel, widest;
attribute vec3 position;
attribute vec3 side;
attribute vec4 colour;
varying vec4 shown;
void main() {
  vec4 place = modelMatrix * vec4(position, 1.0);
  vec2 aside = mat2(modelMatrix[0].xy, modelMatrix[1].xy) * side.xy;
  vec4 middle = projectionMatrix * viewMatrix * place;
  float half_pixel = 0.5 * pixel * middle.w;
  float width = max(side.z, min(half_pixel, widest));
  shown = vec4(colour.rgb, colour.a * clamp(side.z / half_pixel * 1.6, 0.35, 1.0));
  gl_Position = projectionMatrix * viewMatrix * vec4(place.xy + aside * width, place.z, 1.0);
}`;

const FRAGMENT = `
precision highp float;
varying vec4 shown;
void main() { gl_FragColor = shown; }`;

export function lineMaterial(widest = 0.6): RawShaderMaterial {
  return new RawShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    transparent: true,
    depthTest: true,
    depthWrite: false,
    side: DoubleSide,
    uniforms: { pixel: { value: 0.001 }, widest: { value: widest } },
  });
}

/** A mesh of ribbons that is refilled: `begin`, `ribbon` for each, `end`. */
export class Lines {
  readonly mesh: Mesh;
  readonly material: RawShaderMaterial;
  private readonly geometry = new BufferGeometry();
  private readonly position: number[] = [];
  private readonly side: number[] = [];
  private readonly colour: number[] = [];
  private readonly index: number[] = [];
  private capacity = 0;
  private indexCapacity = 0;

  constructor(order: number, widest?: number) {
    this.material = lineMaterial(widest);
    this.mesh = new Mesh(this.geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = order;
    this.begin();
  }

  begin(): void {
    for (const list of [this.position, this.side, this.colour, this.index]) list.length = 0;
  }

  /** Adds a ribbon along x, y in turn; `alpha` is that of a point by its part of the way, 0 to 1. */
  ribbon(
    points: ArrayLike<number>,
    half: number,
    colour: Rgb,
    alpha: (part: number) => number,
    z = 0.03,
  ): void {
    const n = points.length >> 1;
    if (n < 2) return;
    const base = this.position.length / 3;
    for (let i = 0; i < n; i++) {
      const [before, after] = [Math.max(0, i - 1), Math.min(n - 1, i + 1)];
      const dx = points[2 * after] - points[2 * before];
      const dy = points[2 * after + 1] - points[2 * before + 1];
      const length = Math.hypot(dx, dy) || 1;
      const a = alpha(i / (n - 1));
      for (const sign of [-1, 1]) {
        this.position.push(points[2 * i], points[2 * i + 1], z);
        this.side.push((-sign * dy) / length, (sign * dx) / length, half);
        this.colour.push(colour[0], colour[1], colour[2], a);
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

  end(): void {
    const vertices = this.position.length / 3;
    this.mesh.visible = this.index.length > 0;
    if (!this.mesh.visible) return;
    if (vertices > this.capacity || this.index.length > this.indexCapacity) {
      this.geometry.dispose();
      this.capacity = 2 * vertices;
      this.indexCapacity = 2 * this.index.length;
      for (const [name, size] of [
        ["position", 3],
        ["side", 3],
        ["colour", 4],
      ] as const)
        this.geometry.setAttribute(
          name,
          new BufferAttribute(new Float32Array(this.capacity * size), size).setUsage(DynamicDrawUsage),
        );
      this.geometry.setIndex(
        new BufferAttribute(new Uint32Array(this.indexCapacity), 1).setUsage(DynamicDrawUsage),
      );
    }
    for (const [name, values] of [
      ["position", this.position],
      ["side", this.side],
      ["colour", this.colour],
    ] as const) {
      const attribute = this.geometry.getAttribute(name) as BufferAttribute;
      attribute.array.set(values as never);
      attribute.needsUpdate = true;
    }
    const index = this.geometry.getIndex()!;
    index.array.set(this.index as never);
    index.needsUpdate = true;
    this.geometry.setDrawRange(0, this.index.length);
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}
