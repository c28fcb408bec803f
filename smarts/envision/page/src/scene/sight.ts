/** What the chosen agent observes, drawn in the scene: waypoints, neighbours, lidar points, grids. */

import {
  BufferAttribute,
  BufferGeometry,
  DataTexture,
  DoubleSide,
  Mesh,
  NearestFilter,
  RawShaderMaterial,
  RGBAFormat,
} from "three";
import type { Agent } from "../agents";
import type { Recording } from "../episode";
import { type Grid, type Observed, groundOf, observedBy, pixelsOf } from "../observed";
import type { Snapshot } from "../snapshot";
import { Decals } from "./decals";
import { Lines } from "./lines";
import type { Rgb, Theme } from "./palette";

const GRID_VERTEX = `
precision highp float;
uniform mat4 modelMatrix, viewMatrix, projectionMatrix;
attribute vec3 position;
varying vec2 at;
void main() {
  at = vec2(0.5 - position.y, 0.5 - position.x);
  gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4(position, 1.0);
}`;
const GRID_FRAGMENT = `
precision highp float;
uniform sampler2D cells;
varying vec2 at;
void main() { gl_FragColor = texture2D(cells, at); }`;
const GRID_ALPHA = 0.42;
const POINT = 0.22;

/** A square of cells on the ground: x points ahead, y to the left. */
class Floor {
  readonly mesh: Mesh<BufferGeometry, RawShaderMaterial>;
  private texture: DataTexture | null = null;

  constructor() {
    const corners = [0.5, 0.5, 0, 0.5, -0.5, 0, -0.5, -0.5, 0, -0.5, 0.5, 0];
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    const material = new RawShaderMaterial({
      vertexShader: GRID_VERTEX,
      fragmentShader: GRID_FRAGMENT,
      transparent: true,
      depthWrite: false,
      side: DoubleSide,
      uniforms: { cells: { value: null } },
    });
    this.mesh = new Mesh(geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 2;
    this.mesh.visible = false;
  }

  show(grid: Grid | undefined, colour: Rgb): void {
    this.texture?.dispose();
    this.texture = null;
    this.mesh.visible = grid !== undefined;
    if (!grid) return;
    const texture = new DataTexture(pixelsOf(grid, colour, GRID_ALPHA), grid.width, grid.height, RGBAFormat);
    texture.magFilter = NearestFilter;
    texture.needsUpdate = true;
    this.texture = texture;
    this.mesh.material.uniforms.cells.value = texture;
    this.mesh.scale.set(grid.height * grid.size, grid.width * grid.size, 1);
  }

  dispose(): void {
    this.texture?.dispose();
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

export class Sight {
  readonly meshes: Mesh[];
  private readonly floor = new Floor();
  private readonly paths = new Lines(5, 0.4);
  private readonly marks = new Decals(11, 0.06);
  private drawn = "";
  private asked = "";
  private observed: Observed | null = null;

  constructor(private readonly recording: Recording) {
    this.meshes = [this.floor.mesh, this.paths.mesh, this.marks.mesh];
  }

  update(now: Snapshot, chosen: Agent | null, step: number, theme: Theme, pixel: number): void {
    this.paths.material.uniforms.pixel.value = pixel;
    const whole = Math.floor(step + 1e-6);
    const asked = `${chosen?.row ?? -1} ${whole} ${this.recording.table("observations").rows}`;
    if (asked !== this.asked) {
      this.asked = asked;
      this.observed = chosen && observedBy(this.recording, chosen, whole);
    }
    const { observed } = this;
    const key = observed ? `${observed.key} ${theme.name}` : "";
    if (key !== this.drawn) {
      this.drawn = key;
      this.draw(observed, theme);
    }
    const ground = groundOf(observed);
    // It holds for a second, in which the vehicle drives on: it stays where it was seen.
    const pose = ground && chosen && now.agent.subarray(0, now.count).includes(chosen.row)
      ? this.recording.poseOf(chosen.row, ground.step)
      : null;
    this.floor.mesh.visible = pose !== null;
    if (!pose) return;
    this.floor.mesh.position.set(pose[0], pose[1], 0.012);
    this.floor.mesh.rotation.z = pose[2];
  }

  private draw(observed: Observed | null, theme: Theme): void {
    const { paths, marks } = this;
    this.floor.show(groundOf(observed), theme.sight);
    paths.begin();
    marks.begin();
    for (const path of observed?.waypoints ?? []) {
      paths.ribbon(path, 0.12, theme.sight, () => 0.9, 0.04);
      for (let i = 0; i + 1 < path.length; i += 2) this.dot(path[i], path[i + 1], 1.6 * POINT, theme.sight, 1);
    }
    for (const { x, y, heading, length, width } of observed?.neighbors ?? [])
      marks.add({
        x,
        y,
        angle: heading,
        half: [(length > 0 ? length : 4.5) / 2 + 0.5, (width > 0 ? width : 1.8) / 2 + 0.5],
        corner: 0.9,
        soft: 0.2,
        fill: theme.sight,
        alpha: 0.08,
        edge: theme.sight,
        edgeAlpha: 0.95,
        edgeWidth: 0.16,
      });
    const lidar = observed?.lidar ?? [];
    for (let i = 0; i + 1 < lidar.length; i += 2) this.dot(lidar[i], lidar[i + 1], POINT, theme.lidar, 0.95);
    paths.end();
    marks.end();
  }

  private dot(x: number, y: number, radius: number, fill: Rgb, alpha: number): void {
    if (Number.isFinite(x) && Number.isFinite(y))
      this.marks.add({ x, y, half: [radius, radius], corner: radius, soft: 0.06, fill, alpha });
  }

  dispose(): void {
    for (const part of [this.floor, this.paths, this.marks]) part.dispose();
  }
}
