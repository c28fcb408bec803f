/** Time of playback, in seconds since the reset. No DOM. */

export const SPEEDS = [0.25, 0.5, 1, 2, 4, 8] as const;

/** What is live is followed from here on before its end [s]. */
const NEAR = 0.5;

export class Clock {
  t = 0;
  speed = 1;
  isPlaying = false;
  begin = 0;
  end = 0;
  /** Whether the end moves. */
  isLive = false;
  /** Whether playback keeps close to the end that moves, until the user goes back. */
  isFollowing = true;
  /** Whether what was live was cut short. */
  hasEnded = false;

  constructor(private readonly delay = 0.2) {}

  play(): void {
    if (this.t >= this.end - 1e-6 && !this.isLive) this.t = this.begin;
    this.isPlaying = true;
  }

  toggle(): void {
    if (this.isPlaying) this.isPlaying = false;
    else this.play();
  }

  seek(t: number): void {
    this.t = Math.min(this.end, Math.max(this.begin, t));
    this.isFollowing = this.t >= this.end - NEAR;
  }

  /** Moves by whole steps and stops. */
  step(steps: number, dt: number): void {
    this.isPlaying = false;
    this.seek((Math.round(this.t / dt) + steps) * dt);
  }

  /** Advances by real time; returns whether the time has changed. */
  advance(seconds: number): boolean {
    if (!this.isPlaying) return false;
    const before = this.t;
    if (this.isLive && this.isFollowing) this.chase(seconds);
    else if (this.isLive) {
      // What is past is forgotten some time.
      this.t = Math.max(this.begin, this.t + seconds * this.speed);
      if (this.t >= this.end - this.delay) this.isFollowing = true;
    } else {
      this.seek(this.t + seconds * this.speed);
      if (this.t >= this.end) this.isPlaying = false;
    }
    return this.t !== before || this.isPlaying;
  }

  /** Plays a little behind the newest state; catches up smoothly, jumps where it is far behind. */
  private chase(seconds: number): void {
    const goal = Math.max(this.begin, this.end - this.delay);
    const gap = goal - this.t;
    if (gap > 2 || gap < -1) this.t = goal;
    else if (gap > 0) this.t = Math.min(goal, this.t + seconds * this.speed * (1 + Math.max(0, gap - 0.1)));
  }
}
