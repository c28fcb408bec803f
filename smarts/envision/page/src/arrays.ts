/** Decodes the arrays and columns inside messages. No DOM. */

import type { Column, Columns, Numbers } from "./messages";
import { FormatError, type Raw, type RawMap } from "./msgpack";

/** Bytes of the arrays of one message, decompressed. */
export const LARGEST_DECODED = 64 << 20;
const LARGEST_ARRAY = 32 << 20;
const MOST_COLUMNS = 256;

/** What the arrays of one message may still take, so that a small damaged one does not fill the memory. */
export class Budget {
  constructor(private left = LARGEST_DECODED) {}

  take(bytes: number): void {
    if (!Number.isInteger(bytes) || bytes < 0 || bytes > LARGEST_ARRAY)
      throw new FormatError("an array is too large");
    this.left -= bytes;
    if (this.left < 0)
      throw new FormatError(`the arrays of a message are larger than ${LARGEST_DECODED >> 20} MB`);
  }
}

export const isMap = (raw: Raw | undefined): raw is RawMap =>
  typeof raw === "object" && raw !== null && !Array.isArray(raw) && !(raw instanceof Uint8Array);

/** The value as a text; empty where it is a list, a map, bytes or null. */
export const textOf = (raw: Raw | undefined): string =>
  raw === undefined || raw === null || typeof raw === "object" ? "" : String(raw);

/** The value as a number; NaN where it is none. */
export const numberOf = (raw: Raw | undefined): number => (typeof raw === "number" ? raw : NaN);

/** Decompresses to exactly `length` bytes, and stops reading where there are more. */
async function inflate(bytes: Uint8Array, length: number): Promise<Uint8Array> {
  const stream = new Blob([bytes as Uint8Array<ArrayBuffer>])
    .stream()
    .pipeThrough(new DecompressionStream("deflate"));
  const whole = new Uint8Array(length);
  const reader = stream.getReader();
  let at = 0;
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > length) throw new FormatError("a compressed array is longer than it says");
      whole.set(value, at);
      at += value.length;
    }
  } catch (error) {
    void reader.cancel().catch(() => undefined);
    throw error instanceof FormatError ? error : new FormatError("a compressed array is damaged");
  }
  if (at !== length) throw new FormatError("a compressed array is shorter than it says");
  return whole;
}

const ARRAYS = new Map<string, { new (buffer: ArrayBuffer): Numbers; BYTES_PER_ELEMENT: number }>([
  ["u1", Uint8Array],
  ["i1", Int8Array],
  ["u2", Uint16Array],
  ["i2", Int16Array],
  ["u4", Uint32Array],
  ["i4", Int32Array],
  ["f4", Float32Array],
  ["f8", Float64Array],
]);

async function plain(raw: RawMap, budget: Budget): Promise<Uint8Array> {
  if (!(raw.d instanceof Uint8Array)) throw new FormatError("an array has no data");
  const length = raw.z === true ? numberOf(raw.n) : raw.d.length;
  budget.take(length);
  return raw.z === true ? inflate(raw.d, length) : raw.d;
}

/** Returns the typed array of `{t, d, z, n}`. */
export async function numbers(raw: Raw | undefined, budget: Budget): Promise<Numbers> {
  if (!isMap(raw)) throw new FormatError("an array is missing");
  const Type = ARRAYS.get(textOf(raw.t));
  if (!Type) throw new FormatError(`an array has the unknown type '${textOf(raw.t).slice(0, 20)}'`);
  const bytes = await plain(raw, budget);
  if (bytes.length % Type.BYTES_PER_ELEMENT) throw new FormatError("an array has a broken last value");
  // A copy, since views of the message need not be aligned.
  return new Type(bytes.slice().buffer);
}

/** Returns an array of whole numbers. */
export async function integers(raw: Raw | undefined, budget: Budget): Promise<Numbers> {
  const found = await numbers(raw, budget);
  if (found instanceof Float32Array || found instanceof Float64Array)
    throw new FormatError("an array of whole numbers has fractions");
  return found;
}

async function column(raw: Raw | undefined, budget: Budget): Promise<Column> {
  if (Array.isArray(raw)) return raw.map(textOf);
  const values = await numbers(raw, budget);
  if (!isMap(raw) || raw.o === undefined) return values;
  const offsets = await integers(raw.o, budget);
  checkOffsets(offsets, values.length);
  return { values, offsets };
}

/** Returns the columns of a table; other values of the map are ignored. */
export async function columns(raw: Raw | undefined, budget: Budget): Promise<Columns> {
  if (!isMap(raw)) throw new FormatError("a table has no columns");
  const entries = Object.entries(raw).filter(([, value]) => typeof value === "object" && value !== null);
  if (entries.length > MOST_COLUMNS) throw new FormatError(`a table has more than ${MOST_COLUMNS} columns`);
  const found = Object.create(null) as Columns;
  for (const [name, value] of entries) found[name] = await column(value, budget);
  return found;
}

/** Checks that rows of lists begin in order, inside their values. */
export function checkOffsets(offsets: Numbers, length: number): void {
  for (let i = 0; i < offsets.length; i++)
    if (offsets[i] < 0 || offsets[i] > length || (i > 0 && offsets[i] < offsets[i - 1]))
      throw new FormatError("lists lie outside of their values");
}

/** Undoes byte-shuffling, zigzag and first differences; run i has counts[i] values. */
export function integrate(bytes: Uint8Array, counts: Numbers): Int32Array {
  const n = bytes.length >> 2;
  const out = new Int32Array(n);
  let at = 0;
  for (const count of counts) {
    for (let value = 0, end = Math.min(n, at + count); at < end; at++) {
      const code = bytes[at] | (bytes[n + at] << 8) | (bytes[2 * n + at] << 16) | (bytes[3 * n + at] << 24);
      value = (value + ((code >>> 1) ^ -(code & 1))) | 0;
      out[at] = value;
    }
  }
  return out;
}

/** Returns whole numbers that may be packed as differences within runs. */
export async function runs(raw: Raw | undefined, counts: Numbers, budget: Budget): Promise<Int32Array> {
  if (!isMap(raw) || raw.e !== 1) {
    const found = await integers(raw, budget);
    return found instanceof Int32Array ? found : Int32Array.from(found);
  }
  const bytes = await plain(raw, budget);
  if (bytes.length % 4) throw new FormatError("an array has a broken last value");
  return integrate(bytes, counts);
}
