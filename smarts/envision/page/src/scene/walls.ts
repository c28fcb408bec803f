/** Upright walls that fade upwards: membranes of bubbles, beams over goals. */

import { BufferAttribute, BufferGeometry, DoubleSide, Mesh, RawShaderMaterial } from "three";
import type { Rgb } from "./palette";

const VERTEX = `
precision highp float;
uniform mat4 modelMatrix, viewMatrix, projectionMatrix;
uniform float height;
attribute vec3 position;
attribute float along;
varying vec2 at;
void main() {
  at = vec2(along, position.z);
  gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4(position.xy, position.z * height + 0.04, 1.0);
}`;

const FRAGMENT = `
precision highp float;
uniform vec3 colour;
uniform float alpha, dashed;
varying vec2 at;
void main() {
  float shade = pow(1.0 - at.y, 1.6) * alpha;
  if (dashed > 0.5) shade *= step(0.45, fract(at.x / 2.4));
  gl_FragColor = vec4(colour, shade);
}`;

export class Wall {
  readonly mesh: Mesh;
  private readonly geometry = new BufferGeometry();
  private readonly material: RawShaderMaterial;

  /** Builds the wall along closed rings of x, y in turn. */
  constructor(
    rings: readonly ArrayLike<number>[],
    height: number,
    private readonly alpha: number,
    isDashed = false,
  ) {
    const position: number[] = [];
    const along: number[] = [];
    for (const ring of rings) addRing(ring, position, along);
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array(position), 3));
    this.geometry.setAttribute("along", new BufferAttribute(new Float32Array(along), 1));
    this.material = new RawShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
      uniforms: {
        height: { value: height },
        colour: { value: [1, 1, 1] },
        alpha: { value: alpha },
        dashed: { value: isDashed ? 1 : 0 },
      },
    });
    this.mesh = new Mesh(this.geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 20;
  }

  place(x: number, y: number, angle: number, colour: Rgb, strength: number): void {
    this.mesh.position.set(x, y, 0);
    this.mesh.rotation.z = angle;
    this.material.uniforms.colour.value = colour;
    this.material.uniforms.alpha.value = this.alpha * strength;
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}

function addRing(ring: ArrayLike<number>, position: number[], along: number[]): void {
  const n = ring.length >> 1;
  let s = 0;
  for (let i = 0; i < n; i++) {
    const j = (i + 1) % n;
    const [ax, ay, bx, by] = [ring[2 * i], ring[2 * i + 1], ring[2 * j], ring[2 * j + 1]];
    const end = s + Math.hypot(bx - ax, by - ay);
    position.push(ax, ay, 0, bx, by, 0, bx, by, 1, ax, ay, 0, bx, by, 1, ax, ay, 1);
    along.push(s, end, end, s, end, s);
    s = end;
  }
}

/** The corners of a circle as x, y in turn. */
export function circle(radius: number, corners = 48): number[] {
  return Array.from({ length: corners }, (_, i) => (2 * Math.PI * i) / corners).flatMap((a) => [
    radius * Math.cos(a),
    radius * Math.sin(a),
  ]);
}
