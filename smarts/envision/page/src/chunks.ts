/** States of vehicles in chunks of some steps, of which those used last are kept decoded. No DOM. */

import { decode } from "./format";
import type { StepsMessage } from "./messages";

/** Bytes of decoded states that one recording keeps. */
const MOST_BYTES = 48 << 20;
export const ROW_BYTES = 30;
/** Kept whatever their size: those about the time that is shown. */
const FEWEST = 4;

/** The rows of each step lie in `rows`, in order of vehicle. */
export interface States extends StepsMessage {
  rows: Int32Array[];
}

export interface Chunk {
  states: States | null;
  /** From which the states are decoded again; null where they stay. */
  readonly packed: Uint8Array | null;
  readonly bytes: number;
}

export class Chunks {
  /** Called when states that were asked for are there. */
  onArrival: () => void = () => {};
  /** Those that can be dropped, the one used last at the end. */
  private readonly kept = new Set<Chunk>();
  private readonly pending = new Set<Chunk>();
  private size = 0;

  constructor(private readonly most = MOST_BYTES) {}

  /** Keeps a chunk; without `packed` for ever. */
  add(message: StepsMessage, packed: Uint8Array | null): Chunk {
    const bytes = ROW_BYTES * message.flags.length + 4 * message.step.length;
    const chunk: Chunk = { states: statesOf(message), packed, bytes };
    this.keep(chunk);
    return chunk;
  }

  /** The states of a chunk; null where they have to be decoded first, which begins now. */
  get(chunk: Chunk): States | null {
    if (!chunk.states) void this.decode(chunk);
    else if (chunk.packed) {
      this.kept.delete(chunk);
      this.kept.add(chunk);
    }
    return chunk.states;
  }

  private keep(chunk: Chunk): void {
    if (!chunk.packed) return;
    this.kept.add(chunk);
    this.size += chunk.bytes;
    for (const oldest of this.kept) {
      if (this.size <= this.most || this.kept.size <= FEWEST) return;
      oldest.states = null;
      this.kept.delete(oldest);
      this.size -= oldest.bytes;
    }
  }

  private async decode(chunk: Chunk): Promise<void> {
    if (!chunk.packed || this.pending.has(chunk)) return;
    this.pending.add(chunk);
    // It has been decoded before, so nothing can be wrong with it.
    const message = await decode(chunk.packed);
    this.pending.delete(chunk);
    if (message?.type !== "steps") return;
    chunk.states = statesOf(message);
    this.keep(chunk);
    this.onArrival();
  }
}

function statesOf(message: StepsMessage): States {
  const { step, begin, count } = message;
  const sizes = new Int32Array(step.length);
  begin.forEach((first, run) => {
    for (let i = 0; i < count[run]; i++) sizes[first + i]++;
  });
  const rows = Array.from(sizes, (size) => new Int32Array(size));
  sizes.fill(0);
  let row = 0;
  begin.forEach((first, run) => {
    for (let i = 0; i < count[run]; i++) rows[first + i][sizes[first + i]++] = row++;
  });
  return { ...message, rows };
}

/** The row of a vehicle at step number `place` of the chunk, -1 where it is not there. */
export function rowOf({ rows, rowNumber }: States, place: number, number: number): number {
  const of = rows[place];
  let low = 0;
  let high = of.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (rowNumber[of[middle]] < number) low = middle + 1;
    else high = middle;
  }
  return low < of.length && rowNumber[of[low]] === number ? of[low] : -1;
}
