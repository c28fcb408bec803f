/** Bodies of vehicles: one instanced mesh for each class, shaded and animated in one shader. */

import {
  BufferAttribute,
  DoubleSide,
  DynamicDrawUsage,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  Mesh,
  RawShaderMaterial,
} from "three";
import { AIR_LOCK, COLLIDED, Snapshot, type Vehicle } from "../episode";
import type { Rgb, Theme } from "./palette";
import { Shape, shapeOf, SHAPES } from "./shapes";

const VERTEX = `
precision highp float;
uniform mat4 viewMatrix, projectionMatrix;
uniform vec3 glass, tyre;
uniform vec2 light;
uniform float blink;
attribute vec3 position, normal;
attribute vec3 pivot;
attribute float part;
attribute vec4 pose, form;
attribute vec3 paint;
attribute float flags;
varying vec3 colour;
varying vec3 stripe;
float bit(float n) { return mod(floor(flags / exp2(n)), 2.0); }
void main() {
  vec3 p = position * form.xyz;
  vec3 n = normal;
  if (pivot.z > 0.5) {
    vec2 c = pivot.xy * form.xy;
    float a = pose.w, s = sin(a), k = cos(a);
    p.xy = c + mat2(k, s, -s, k) * (p.xy - c);
    n.xy = mat2(k, s, -s, k) * n.xy;
  }
  float s = sin(pose.z), k = cos(pose.z);
  mat2 turn = mat2(k, s, -s, k);
  vec3 facing = vec3(turn * n.xy, n.z);
  float lit = mix(light.y, light.x, clamp(0.5 + 0.5 * dot(facing, normalize(vec3(-0.45, 0.35, 0.82))), 0.0, 1.0));
  float wreck = bit(8.0);
  vec3 base = mix(paint, paint * 0.55 + 0.06, wreck);
  float glow = 0.0;
  if (part < 0.5) colour = base;
  else if (part < 1.5) colour = mix(glass, paint * 0.35, 0.12);
  else if (part < 2.5) colour = tyre;
  else if (part < 3.5) { colour = vec3(1.0, 0.97, 0.88); glow = 0.75; }
  else if (part < 4.5) { float on = bit(3.0); colour = mix(vec3(0.42, 0.03, 0.05), vec3(1.0, 0.1, 0.12), on); glow = on; }
  else if (part < 6.5) { float on = bit(part < 5.5 ? 4.0 : 5.0) * blink; colour = mix(base * 0.72, vec3(1.0, 0.68, 0.1), on); glow = on; }
  else if (part > 7.5) colour = mix(tyre, vec3(0.75, 0.78, 0.82), 0.6);
  else colour = mix(base, vec3(0.93, 0.95, 0.97), 0.4);
  colour *= mix(lit, 1.0, glow);
  stripe = vec3(p.xy, part < 0.5 ? bit(6.0) * lit : 0.0);
  gl_Position = projectionMatrix * viewMatrix * vec4(turn * p.xy + pose.xy, p.z, 1.0);
}`;

const FRAGMENT = `
precision highp float;
uniform vec3 social;
varying vec3 colour;
varying vec3 stripe;
void main() {
  vec3 shown = colour;
  if (stripe.z > 0.01 && fract((stripe.x + stripe.y) / 1.3) < 0.5) shown = social * stripe.z;
  gl_FragColor = vec4(shown, 1.0);
}`;

class Fleet {
  readonly mesh: Mesh;
  private readonly geometry = new InstancedBufferGeometry();
  private capacity = 0;
  private count = 0;
  private pose!: InstancedBufferAttribute;
  private form!: InstancedBufferAttribute;
  private paint!: InstancedBufferAttribute;
  private flags!: InstancedBufferAttribute;

  constructor(
    private readonly shape: Shape,
    material: RawShaderMaterial,
  ) {
    const { position, normal, pivot, part, index } = shape.arrays;
    this.geometry.setIndex(new BufferAttribute(index, 1));
    this.geometry.setAttribute("position", new BufferAttribute(position, 3));
    this.geometry.setAttribute("normal", new BufferAttribute(normal, 3));
    this.geometry.setAttribute("pivot", new BufferAttribute(pivot, 3));
    this.geometry.setAttribute("part", new BufferAttribute(part, 1));
    this.grow(32);
    this.mesh = new Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 10;
  }

  private grow(capacity: number): void {
    const attribute = (name: string, size: number, old?: InstancedBufferAttribute) => {
      const values = new Float32Array(capacity * size);
      if (old) values.set(old.array as Float32Array);
      const made = new InstancedBufferAttribute(values, size).setUsage(DynamicDrawUsage);
      this.geometry.setAttribute(name, made);
      return made;
    };
    if (this.capacity) this.geometry.dispose();
    this.capacity = capacity;
    this.pose = attribute("pose", 4, this.pose);
    this.form = attribute("form", 4, this.form);
    this.paint = attribute("paint", 3, this.paint);
    this.flags = attribute("flags", 1, this.flags);
  }

  begin(): void {
    this.count = 0;
  }

  add(from: Snapshot, i: number, vehicle: Vehicle | undefined, colour: Rgb): void {
    if (this.count === this.capacity) this.grow(2 * this.capacity);
    const at = this.count++;
    const length = vehicle?.length || this.shape.length;
    const width = vehicle?.width || this.shape.width;
    this.pose.setXYZW(at, from.x[i], from.y[i], from.heading[i], from.steer[i]);
    this.form.setXYZW(at, length, width, this.shape.height, 0);
    this.paint.setXYZ(at, colour[0], colour[1], colour[2]);
    this.flags.setX(at, from.flags[i] & (COLLIDED | AIR_LOCK | 0x38));
  }

  /** Shows what was added; from afar without details. */
  end(isFar: boolean): void {
    this.geometry.instanceCount = this.count;
    this.geometry.setDrawRange(0, isFar ? this.shape.coarse : Infinity);
    this.mesh.visible = this.count > 0;
    for (const attribute of [this.pose, this.form, this.paint, this.flags]) {
      attribute.clearUpdateRanges();
      attribute.addUpdateRange(0, this.count * attribute.itemSize);
      attribute.needsUpdate = true;
    }
  }

  dispose(): void {
    this.geometry.dispose();
  }
}

/** All vehicles of one scene. */
export class Bodies {
  readonly meshes: Mesh[];
  private readonly fleets: Fleet[];
  private readonly material = new RawShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    side: DoubleSide,
    uniforms: {
      glass: { value: [0, 0, 0] },
      tyre: { value: [0, 0, 0] },
      light: { value: [1, 0.5] },
      blink: { value: 1 },
      social: { value: [1, 0.5, 0] },
    },
  });

  constructor() {
    this.fleets = SHAPES.map((shape) => new Fleet(shape, this.material));
    this.meshes = this.fleets.map((fleet) => fleet.mesh);
  }

  update(from: Snapshot, vehicles: readonly Vehicle[], theme: Theme, seconds: number, isFar: boolean): void {
    const { uniforms } = this.material;
    uniforms.glass.value = theme.glass;
    uniforms.tyre.value = theme.tyre;
    uniforms.light.value = theme.light;
    uniforms.social.value = theme.drivers[1];
    uniforms.blink.value = (seconds * 1.5) % 1 < 0.55 ? 1 : 0;
    for (const fleet of this.fleets) fleet.begin();
    for (let i = 0; i < from.count; i++) {
      const vehicle = vehicles[from.number[i]];
      this.fleets[shapeOf(vehicle?.kind ?? 0)].add(from, i, vehicle, theme.drivers[from.driver[i] as 0]);
    }
    for (const fleet of this.fleets) fleet.end(isFar);
  }

  dispose(): void {
    for (const fleet of this.fleets) fleet.dispose();
    this.material.dispose();
  }
}
