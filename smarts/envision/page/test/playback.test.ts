/** Clocks of what is live. */

import { describe, expect, it } from "vitest";
import { Clock } from "../src/playback";

function live(end: number): Clock {
  const clock = new Clock();
  Object.assign(clock, { isLive: true, end });
  clock.play();
  clock.advance(0.1);
  return clock;
}

describe("a clock of what is live", () => {
  it("keeps close to the end until one goes back, then plays from there", () => {
    const clock = live(60);
    expect(clock.t).toBeCloseTo(59.8);
    clock.seek(20);
    clock.end = 61;
    clock.advance(0.5);
    expect(clock.t).toBeCloseTo(20.5);
    clock.speed = 2;
    clock.advance(1);
    expect([clock.t, clock.isFollowing, clock.isPlaying]).toEqual([22.5, false, true]);
  });

  it("follows again where it has caught up, or is sent to the end", () => {
    const clock = live(60);
    clock.seek(58);
    clock.advance(1.9);
    expect(clock.isFollowing).toBe(true);
    clock.seek(10);
    clock.seek(60);
    clock.end = 63;
    clock.advance(0.1);
    expect(clock.t).toBeCloseTo(62.8);
  });

  it("does not stay in what is forgotten, and stops where it is stopped", () => {
    const clock = live(60);
    clock.seek(5);
    clock.begin = 30;
    clock.advance(0.1);
    expect(clock.t).toBe(30);
    clock.toggle();
    clock.end = 90;
    expect(clock.advance(1)).toBe(false);
    expect(clock.t).toBe(30);
  });
});
