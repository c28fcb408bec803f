/** Bubbles: the membrane of the zone, the dashed one of the margin, and the floor; they move with their poses. */

import {
  BufferAttribute,
  BufferGeometry,
  type Group,
  Mesh,
  RawShaderMaterial,
  Shape as Outline,
  ShapeUtils,
  Vector2,
} from "three";
import type { Recording } from "../episode";
import type { Theme } from "./palette";
import { Lines } from "./lines";
import { Wall } from "./walls";

const FLOOR_VERTEX = `
precision highp float;
uniform mat4 modelMatrix, viewMatrix, projectionMatrix;
attribute vec3 position;
void main() { gl_Position = projectionMatrix * viewMatrix * modelMatrix * vec4(position, 1.0); }`;
const FLOOR_FRAGMENT = `
precision mediump float;
uniform vec4 colour;
void main() { gl_FragColor = colour; }`;

interface Parts {
  bubble: number;
  zone: Wall;
  margin: Wall;
  floor: Mesh<BufferGeometry, RawShaderMaterial>;
  /** Where the membrane stands: from above it has no width. */
  foot: Lines;
  footOf: Theme | null;
}

export class Bubbles {
  private readonly parts: Parts[] = [];

  constructor(
    private readonly recording: Recording,
    group: Group,
  ) {
    for (const bubble of new Set(recording.table("bubble_rings").numbers("bubble"))) {
      const zone = this.rings(bubble, 0);
      const parts: Parts = {
        bubble,
        zone: new Wall(zone, 5.5, 0.5),
        margin: new Wall(this.rings(bubble, 1), 1.2, 0.75, true),
        floor: floor(zone),
        foot: new Lines(3, 2),
        footOf: null,
      };
      this.parts.push(parts);
      group.add(parts.zone.mesh, parts.margin.mesh, parts.floor, parts.foot.mesh);
    }
  }

  /** The rings of a bubble as x, y in turn. */
  private rings(bubble: number, isMargin: number): number[][] {
    const table = this.recording.table("bubble_rings");
    const rings: number[][] = [];
    for (let row = 0; row < table.rows; row++) {
      if (table.numbers("bubble")[row] !== bubble || table.numbers("is_margin")[row] !== isMargin) continue;
      const [x, y] = [table.list("x", row), table.list("y", row)];
      rings.push(Array.from(x).flatMap((value, i) => [value, y[i]]));
    }
    return rings;
  }

  update(step: number, theme: Theme, pixel: number): void {
    const table = this.recording.table("bubble_poses");
    const index = this.recording.index("bubble_poses", "bubble");
    const [x0, y0] = this.recording.origin;
    for (const parts of this.parts) {
      const { bubble, zone, margin, floor, foot } = parts;
      if (parts.footOf !== theme) this.drawFoot(parts, theme);
      foot.material.uniforms.pixel.value = pixel;
      const row = index.at(bubble, step);
      const [x, y, angle] = this.pose(bubble, row, step);
      const isActive = row >= 0 && table.numbers("is_active")[row] === 1;
      zone.place(x - x0, y - y0, angle, theme.bubble, isActive ? 1 : 0.25);
      margin.place(x - x0, y - y0, angle, theme.bubble, isActive ? 1 : 0.5);
      for (const mesh of [floor, foot.mesh]) {
        mesh.position.set(x - x0, y - y0, 0.01);
        mesh.rotation.z = angle;
      }
      floor.material.uniforms.colour.value = [...theme.bubble, isActive ? 0.1 : 0];
      for (const mesh of [zone.mesh, margin.mesh, floor, foot.mesh]) mesh.visible = row >= 0;
    }
  }

  private drawFoot(parts: Parts, theme: Theme): void {
    parts.footOf = theme;
    parts.foot.begin();
    for (const [isMargin, half, alpha] of [
      [0, 0.2, 0.8],
      [1, 0.08, 0.4],
    ])
      for (const ring of this.rings(parts.bubble, isMargin))
        parts.foot.ribbon([...ring, ...ring.slice(0, 4)], half, theme.bubble, () => alpha, 0.03);
    parts.foot.end();
  }

  /** The pose at a step; between rows of steps in turn it moves evenly. */
  private pose(bubble: number, row: number, step: number): [number, number, number] {
    const table = this.recording.table("bubble_poses");
    const [steps, xs, ys, angles] = ["step", "x", "y", "angle"].map((name) => table.numbers(name));
    if (row < 0) return [0, 0, 0];
    const after = this.recording.index("bubble_poses", "bubble").at(bubble, steps[row] + 1);
    if (after === row || after < 0) return [xs[row], ys[row], angles[row]];
    const part = Math.min(1, step - steps[row]);
    const turn = angles[after] - angles[row];
    const short = turn - 2 * Math.PI * Math.round(turn / (2 * Math.PI));
    return [
      xs[row] + part * (xs[after] - xs[row]),
      ys[row] + part * (ys[after] - ys[row]),
      angles[row] + part * short,
    ];
  }

  dispose(): void {
    for (const { zone, margin, floor, foot } of this.parts) {
      for (const mesh of [zone.mesh, margin.mesh, floor, foot.mesh]) mesh.removeFromParent();
      foot.dispose();
      zone.dispose();
      margin.dispose();
      floor.geometry.dispose();
      floor.material.dispose();
    }
  }
}

/** Fills rings by the even-odd rule: a ring inside an odd number of others is a hole of the smallest of them. */
function floor(rings: readonly number[][]): Mesh<BufferGeometry, RawShaderMaterial> {
  const outlines = rings.map((ring) =>
    Array.from({ length: ring.length >> 1 }, (_, i) => new Vector2(ring[2 * i], ring[2 * i + 1])),
  );
  const around = outlines.map((ring, i) =>
    outlines.filter((other, j) => j !== i && isInside(ring[0], other)),
  );
  const position: number[] = [];
  const index: number[] = [];
  outlines.forEach((outer, i) => {
    if (around[i].length % 2) return;
    const holes = outlines.filter(
      (_, j) => around[j].length === around[i].length + 1 && around[j].includes(outer),
    );
    const shape = new Outline(outer);
    const points = shape.getPoints(1);
    const base = position.length / 3;
    const all = [points, ...holes];
    for (const ring of all) for (const point of ring) position.push(point.x, point.y, 0);
    for (const face of ShapeUtils.triangulateShape(points, holes))
      index.push(...face.map((corner) => base + corner));
  });
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(position), 3));
  geometry.setIndex(index);
  const material = new RawShaderMaterial({
    vertexShader: FLOOR_VERTEX,
    fragmentShader: FLOOR_FRAGMENT,
    transparent: true,
    depthWrite: false,
    side: 2,
    uniforms: { colour: { value: [1, 1, 1, 0.1] } },
  });
  const mesh = new Mesh(geometry, material);
  mesh.frustumCulled = false;
  mesh.renderOrder = 2;
  return mesh;
}

function isInside(point: Vector2, ring: readonly Vector2[]): boolean {
  let inside = false;
  ring.forEach((a, i) => {
    const b = ring[(i + 1) % ring.length];
    if (a.y > point.y !== b.y > point.y && point.x < ((b.x - a.x) * (point.y - a.y)) / (b.y - a.y) + a.x)
      inside = !inside;
  });
  return inside;
}
