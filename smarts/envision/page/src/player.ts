/** Playback of one view or several: one clock for all, or one for each. */

import { Clock, SPEEDS } from "./playback";
import type { View } from "./view";

export class Player {
  readonly views: View[] = [];
  /** The clock of views in step. */
  readonly shared = new Clock();
  isInStep = true;
  /** The view to which keys and the panel belong. */
  focus = 0;
  /** Whether a picture is due although no clock runs. */
  private hasJumped = false;

  get view(): View | null {
    return this.views[this.focus] ?? null;
  }

  get clock(): Clock {
    return this.isInStep && this.views.length > 1 ? this.shared : (this.view?.clock ?? this.shared);
  }

  get dt(): number {
    return this.view?.recording.dt ?? 0.1;
  }

  /** Takes up how far recordings reach. */
  syncEnds(): void {
    for (const view of this.views) view.refresh();
    const begins = this.views.map((view) => view.clock.begin);
    this.shared.begin = begins.length ? Math.min(...begins) : 0;
    this.shared.end = Math.max(0, ...this.views.map((view) => view.clock.end));
    this.shared.isLive = this.views.some((view) => view.clock.isLive);
  }

  toggle(): void {
    this.clock.toggle();
  }

  seek(t: number): void {
    this.clock.seek(t);
    this.hasJumped = true;
  }

  /** Moves by whole steps and stops. */
  stepBy(steps: number): void {
    this.clock.step(steps, this.dt);
    this.hasJumped = true;
  }

  setSpeed(speed: number): void {
    this.clock.speed = speed;
  }

  changeSpeed(sign: number): void {
    const place = SPEEDS.findIndex((speed) => speed >= this.clock.speed) + sign;
    this.setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, place))]);
  }

  goLive(): void {
    this.seek(this.clock.end);
    this.clock.play();
  }

  setInStep(isInStep: boolean): void {
    const { t, speed, isPlaying } = this.clock;
    this.isInStep = isInStep;
    for (const clock of [this.shared, ...this.views.map((view) => view.clock)]) {
      clock.seek(t);
      Object.assign(clock, { speed, isPlaying });
    }
  }

  /** Advances by real time; returns whether a picture is due. */
  advance(seconds: number): boolean {
    const { hasJumped } = this;
    this.hasJumped = false;
    if (!this.isInStep || this.views.length < 2)
      return this.views.map((view) => view.clock.advance(seconds)).some(Boolean) || hasJumped;
    const hasMoved = this.shared.advance(seconds);
    for (const view of this.views) {
      view.clock.seek(this.shared.t);
      view.clock.speed = this.shared.speed;
      view.clock.isPlaying = this.shared.isPlaying;
    }
    return hasMoved || hasJumped;
  }
}
