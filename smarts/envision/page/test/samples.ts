/** What tests share: episodes that Python wrote, a generator of random numbers, a writer of msgpack. */

import { readFileSync } from "node:fs";
import { join } from "node:path";
import { MAGIC } from "../src/container";

export const FOLDER = join(import.meta.dirname, "../../../../tests/data/envision");
export const bytesOf = (name: string) => new Uint8Array(readFileSync(join(FOLDER, `${name}.smarts`)));

/** Returns numbers from 0 to 1; the same seed gives the same ones, so that failures can be repeated. */
export function random(seed: number): () => number {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}

type Value = null | boolean | number | string | Uint8Array | Value[] | { [key: string]: Value };

const long = (value: number) => [value >>> 24, (value >>> 16) & 255, (value >>> 8) & 255, value & 255];

/** Writes msgpack: whole numbers in 32 bits, other numbers in 64. */
export function packed(value: Value): number[] {
  if (value === null) return [0xc0];
  if (typeof value === "boolean") return [value ? 0xc3 : 0xc2];
  if (typeof value === "number") {
    if (Number.isInteger(value) && value >= 0 && value < 2 ** 32) return [0xce, ...long(value)];
    const bytes = new Uint8Array(8);
    new DataView(bytes.buffer).setFloat64(0, value);
    return [0xcb, ...bytes];
  }
  if (typeof value === "string") {
    const bytes = new TextEncoder().encode(value);
    return [0xdb, ...long(bytes.length), ...bytes];
  }
  if (value instanceof Uint8Array) return [0xc6, ...long(value.length), ...value];
  if (Array.isArray(value)) return [0xdd, ...long(value.length), ...value.flatMap(packed)];
  const entries = Object.entries(value);
  return [0xdf, ...long(entries.length), ...entries.flatMap(([key, each]) => [...packed(key), ...packed(each)])];
}

type Array_ = Uint8Array | Int8Array | Uint16Array | Int32Array | Uint32Array | Float32Array;
const TYPES = new Map<string, string>([
  ["Uint8Array", "u1"],
  ["Int8Array", "i1"],
  ["Uint16Array", "u2"],
  ["Int32Array", "i4"],
  ["Uint32Array", "u4"],
  ["Float32Array", "f4"],
]);

/** An array as it is inside a message. */
export const array = (values: Array_): Value => ({
  t: TYPES.get(values.constructor.name) ?? "",
  d: new Uint8Array(values.buffer, values.byteOffset, values.byteLength),
});

export const messageOf = (value: Value): Uint8Array => Uint8Array.from(packed(value));

/** Puts messages behind their lengths. */
export function containerOf(messages: readonly Uint8Array[]): Uint8Array {
  const size = messages.reduce((sum, message) => sum + 4 + message.length, MAGIC.length);
  const bytes = new Uint8Array(size);
  bytes.set(new TextEncoder().encode(MAGIC));
  let at = MAGIC.length;
  for (const message of messages) {
    new DataView(bytes.buffer).setUint32(at, message.length, true);
    bytes.set(message, at + 4);
    at += 4 + message.length;
  }
  return bytes;
}

/** The messages of a compact episode, undecoded. */
export function messagesIn(bytes: Uint8Array): Uint8Array[] {
  const view = new DataView(bytes.buffer, bytes.byteOffset);
  const messages: Uint8Array[] = [];
  for (let at = MAGIC.length; at < bytes.length; ) {
    const size = view.getUint32(at, true);
    messages.push(bytes.slice(at + 4, at + 4 + size));
    at += 4 + size;
  }
  return messages;
}

/** The message of some consecutive steps in which some vehicles stand in a row, 10 m apart. */
export function stepsOf(first: number, steps: number, vehicles: number): Uint8Array {
  const rows = steps * vehicles;
  const fill = (each: (vehicle: number, step: number) => number) =>
    Int32Array.from({ length: rows }, (_, row) => each(Math.floor(row / steps), first + (row % steps)));
  return messageOf({
    type: "steps",
    step: array(Int32Array.from({ length: steps }, (_, i) => first + i)),
    number: array(Uint32Array.from({ length: vehicles }, (_, i) => i)),
    begin: array(new Uint16Array(vehicles)),
    count: array(new Uint16Array(vehicles).fill(steps)),
    x: array(fill((vehicle) => 1000 * vehicle)),
    y: array(fill((_, step) => 100 * step)),
    heading: array(new Int32Array(rows)),
    speed: array(fill((_, step) => step)),
    steer: array(new Int32Array(rows)),
    flags: array(new Uint16Array(rows).fill(1)),
  });
}

export const EPISODE = messageOf({ type: "episode", version: 1, facts: { dt: 0.1 }, names: {}, origin: [0, 0] });
