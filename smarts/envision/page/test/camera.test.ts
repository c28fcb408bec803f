/** What the camera sees. */

import { Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { Rig } from "../src/scene/camera";
import { random } from "./samples";

describe.each(["top", "free"] as const)("the camera %s", (mode) => {
  it("sees all that projects into the picture, and not what is far outside", () => {
    const draw = random(3);
    let inside = 0;
    let hidden = 0;
    for (let trial = 0; trial < 40; trial++) {
      const rig = new Rig();
      rig.resize(900, 600);
      rig.setMode(mode);
      Object.assign(rig.aim, { x: 100 * draw(), y: -50, distance: 20 + 300 * draw(), azimuth: 6 * draw() });
      if (mode === "free") rig.aim.tilt = 1.4 * draw();
      rig.update(100);
      for (let i = 0; i < 200; i++) {
        const [x, y] = [1000 * draw() - 450, 1000 * draw() - 550];
        const at = new Vector3(x, y, 0);
        const depth = -at.clone().applyMatrix4(rig.camera.matrixWorldInverse).z;
        at.project(rig.camera);
        const isInside = Math.abs(at.x) < 1 && Math.abs(at.y) < 1 && depth > rig.camera.near;
        if (isInside) expect(rig.sees(x, y, 0.01)).toBe(true);
        if (isInside) inside++;
        else if (!rig.sees(x, y, 5)) hidden++;
        const ground = isInside && rig.ground((1 + at.x) / 2, (1 - at.y) / 2);
        if (ground) expect(Math.hypot(ground.x - x, ground.y - y)).toBeLessThan(0.5);
      }
    }
    expect(inside).toBeGreaterThan(100);
    expect(hidden).toBeGreaterThan(1000);
  });
});
