/** Shapes that are drawn many times. */

import { expect, it } from "vitest";
import { Copies } from "../src/scene/copies";
import { Decals } from "../src/scene/decals";

it("gives each corner of a copy the copy's numbers, also when there are more than there was room for", () => {
  const square = {
    attributes: { position: { values: [0, 0, 1, 0, 1, 1], size: 2 } },
    corners: 3,
    index: [0, 1, 2],
  };
  const copies = new Copies(square, { pose: 2, shade: 1 });
  for (const count of [2, 100, 70]) {
    copies.begin();
    for (let i = 0; i < count; i++) {
      const at = copies.add();
      copies.values.set([i, 2 * i, count], at);
    }
    copies.end();
    const { geometry } = copies;
    expect(geometry.drawRange.count).toBe(3 * count);
    const [pose, shade, position] = ["pose", "shade", "position"].map((name) => geometry.getAttribute(name));
    const index = geometry.getIndex()!;
    for (let k = 0; k < 3 * count; k++) {
      const corner = index.getX(k);
      const i = Math.floor(k / 3);
      expect(Math.floor(corner / 3)).toBe(i);
      expect([pose.getX(corner), pose.getY(corner), shade.getX(corner)]).toEqual([i, 2 * i, count]);
      expect([position.getX(corner), position.getY(corner)]).toEqual([[0, 0], [1, 0], [1, 1]][k % 3]);
    }
  }
});

it("is not drawn without copies", () => {
  const decals = new Decals(1, 0);
  decals.begin();
  decals.put(1, 2, 0, 1, 1, 0, 0, [1, 1, 1], 1);
  decals.end();
  expect(decals.mesh.visible).toBe(true);
  decals.begin();
  decals.end();
  expect(decals.mesh.visible).toBe(false);
});
