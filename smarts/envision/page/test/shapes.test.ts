/** Bodies of vehicles: what is drawn of them, and from which side. */

import { describe, expect, it } from "vitest";
import { Detail, Part } from "../src/scene/shape";
import { SHAPES } from "../src/scene/shapes";

describe.each(SHAPES.map((shape, i) => [i, shape] as const))("shape %d", (_, shape) => {
  const { position, normal, part, index } = shape.arrays;
  const corner = (list: Float32Array, i: number) => [...list.subarray(3 * i, 3 * i + 3)];
  const metres = (i: number) => {
    const [x, y, z] = corner(position, i);
    return [x * shape.length, y * shape.width, z * shape.height];
  };

  it("has triangles that face the way that they are lit", () => {
    for (let i = 0; i < index.length; i += 3) {
      const [a, b, c] = [...index.subarray(i, i + 3)].map(metres);
      const [u, v] = [b.map((value, k) => value - a[k]), c.map((value, k) => value - a[k])];
      const face = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const facing = [0, 1, 2].reduce((sum, k) => {
        const n = corner(normal, index[i + k]);
        return sum + n[0] * face[0] + n[1] * face[1] + n[2] * face[2];
      }, 0);
      expect(facing).toBeGreaterThanOrEqual(0);
    }
  });

  it("is a block with brake lights from afar, and its parts nearby", () => {
    const partsOf = (detail: Detail) => {
      const [start, count] = shape.ranges[detail];
      return [...index.subarray(start, Math.min(index.length, start + count))].map((i) => part[i]);
    };
    const [all, coarse, block, tops] = [Detail.All, Detail.Coarse, Detail.Block, Detail.Tops].map(partsOf);
    expect(tops.length).toBeLessThanOrEqual(24);
    expect(block.slice(0, tops.length)).toEqual(tops);
    expect(block.length).toBe(tops.length + 30);
    expect(tops).toContain(Part.TailLight);
    expect(coarse.length).toBeGreaterThan(3 * block.length);
    expect(coarse).toContain(Part.LeftIndicator);
    expect(all.length).toBeGreaterThanOrEqual(coarse.length);
    expect(all.slice(0, coarse.length)).toEqual(coarse);
  });

  it("stays within its length and width, and stands on the ground", () => {
    for (let i = 0; i < part.length; i++) {
      const [x, y, z] = corner(position, i);
      expect(Math.abs(x)).toBeLessThan(0.53);
      expect(Math.abs(y)).toBeLessThan(0.53);
      expect(z).toBeGreaterThanOrEqual(0);
      expect(z).toBeLessThanOrEqual(1.001);
    }
  });
});
