/** Bodies of vehicles: one instanced mesh for each class, shaded and animated in one shader. */

import {
  BufferAttribute,
  InstancedBufferGeometry,
  Mesh,
  RawShaderMaterial,
} from "three";
import type { Vehicle } from "../episode";
import { AIR_LOCK, COLLIDED, type Snapshot } from "../snapshot";
import { Instances } from "./instances";
import type { Rgb, Theme } from "./palette";
import { Copies } from "./copies";
import { Detail, type Shape } from "./shape";
import { shapeOf, SHAPES } from "./shapes";

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
varying vec3 colour;
varying vec3 stripe;
float bit(float n) { return mod(floor(form.w / exp2(n)), 2.0); }
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

const NUMBERS = { pose: 4, form: 4, paint: 3 };

/** The vehicles of one class: instances nearby, where few are in the picture, and copies of few corners from afar. */
class Fleet {
  readonly mesh: Mesh;
  readonly meshes: Mesh[];
  private readonly geometry = new InstancedBufferGeometry();
  private readonly instances: Instances;
  private readonly afar: Readonly<Record<Detail.Block | Detail.Tops, Copies>>;
  private used: Instances | Copies;

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
    this.instances = new Instances(this.geometry, NUMBERS);
    this.used = this.instances;
    this.afar = {
      [Detail.Block]: new Copies(shape.stencil(Detail.Block), NUMBERS),
      [Detail.Tops]: new Copies(shape.stencil(Detail.Tops), NUMBERS),
    };
    this.mesh = new Mesh(this.geometry, material);
    this.meshes = [this.mesh, ...[Detail.Block, Detail.Tops].map((each) => this.meshOf(each as Detail.Block, material))];
    for (const mesh of this.meshes) {
      mesh.frustumCulled = false;
      mesh.renderOrder = 10;
    }
  }

  private meshOf(detail: Detail.Block | Detail.Tops, material: RawShaderMaterial): Mesh {
    return new Mesh(this.afar[detail].geometry, material);
  }

  begin(detail: Detail): void {
    this.used = detail === Detail.Block || detail === Detail.Tops ? this.afar[detail] : this.instances;
    this.used.begin();
  }

  add(from: Snapshot, i: number, vehicle: Vehicle | undefined, colour: Rgb): void {
    const at = this.used.add();
    const { values } = this.used;
    values[at] = from.x[i];
    values[at + 1] = from.y[i];
    values[at + 2] = from.heading[i];
    values[at + 3] = from.steer[i];
    values[at + 4] = vehicle?.length || this.shape.length;
    values[at + 5] = vehicle?.width || this.shape.width;
    values[at + 6] = this.shape.height;
    values[at + 7] = from.flags[i] & (COLLIDED | AIR_LOCK | 0x38);
    values[at + 8] = colour[0];
    values[at + 9] = colour[1];
    values[at + 10] = colour[2];
  }

  /** Shows what was added. */
  end(detail: Detail): void {
    this.used.end();
    if (this.used === this.instances) this.geometry.setDrawRange(...this.shape.ranges[detail]);
    const all = [this.instances, this.afar[Detail.Block], this.afar[Detail.Tops]];
    this.meshes.forEach((mesh, i) => (mesh.visible = all[i] === this.used && this.used.count > 0));
  }

  dispose(): void {
    for (const copies of Object.values(this.afar)) copies.dispose();
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
    this.meshes = this.fleets.flatMap((fleet) => fleet.meshes);
  }

  update(from: Snapshot, vehicles: readonly (Vehicle | undefined)[], theme: Theme, seconds: number, detail: Detail): void {
    const { uniforms } = this.material;
    uniforms.glass.value = theme.glass;
    uniforms.tyre.value = theme.tyre;
    uniforms.light.value = theme.light;
    uniforms.social.value = theme.drivers[1];
    uniforms.blink.value = (seconds * 1.5) % 1 < 0.55 ? 1 : 0;
    for (const fleet of this.fleets) fleet.begin(detail);
    for (let i = 0; i < from.count; i++) {
      if (!from.isSeen[i]) continue;
      const vehicle = vehicles[from.number[i]];
      this.fleets[shapeOf(vehicle?.kind ?? 0)].add(from, i, vehicle, theme.drivers[from.driver[i] as 0]);
    }
    for (const fleet of this.fleets) fleet.end(detail);
  }

  dispose(): void {
    for (const fleet of this.fleets) fleet.dispose();
    this.material.dispose();
  }
}
