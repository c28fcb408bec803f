/** The vehicles at a time, as arrays. No DOM. */

export const AIR_LOCK = 1 << 6;
export const COLLIDED = 1 << 8;
export const OWNER = 7;
export const RETURNING = 1 << 7;
export const OWNER_AGENT = 2;

/** By whom a vehicle is driven: what its colour says. */
export enum Driver {
  Ego,
  Social,
  Traffic,
  Fallback,
  Other,
}

/** The vehicles at a time; the arrays are refilled by `sample`, entries from `count` on mean nothing. */
export class Snapshot {
  count = 0;
  number = new Uint32Array(64);
  x = new Float32Array(64);
  y = new Float32Array(64);
  heading = new Float32Array(64);
  speed = new Float32Array(64);
  steer = new Float32Array(64);
  flags = new Uint16Array(64);
  driver = new Uint8Array(64);
  /** Whether it may be in the picture. */
  isSeen = new Uint8Array(64);
  /** Row in the table agents, -1 for none. */
  agent = new Int32Array(64);
  /** Place of each vehicle number in the arrays, -1 for none. */
  place = new Int32Array(64).fill(-1);

  reserve(count: number, numbers: number): void {
    if (count > this.number.length) {
      const size = 2 * count;
      this.number = new Uint32Array(size);
      for (const name of ["x", "y", "heading", "speed", "steer"] as const)
        this[name] = new Float32Array(size);
      this.flags = new Uint16Array(size);
      this.driver = new Uint8Array(size);
      this.isSeen = new Uint8Array(size);
      this.agent = new Int32Array(size);
    }
    if (numbers > this.place.length) this.place = new Int32Array(2 * numbers);
    this.place.fill(-1);
  }
}
