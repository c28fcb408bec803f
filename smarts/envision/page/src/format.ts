/** Decodes the stream of messages that a compact episode, an HTTP answer and a WebSocket carry. No DOM. */

import { FormatError, type Raw, type RawMap, unpack } from "./msgpack";

export { FormatError, unpack };

export const MAGIC = "SMARTSEP";
export const VERSION = 1;
export const LARGEST_MESSAGE = 8 << 20;
const LARGEST_ARRAY = 32 << 20;
const MOST_ROWS = 1_000_000;
const MOST_VEHICLES = 1 << 20;

export type Numbers =
  Uint8Array | Int8Array | Uint16Array | Int16Array | Uint32Array | Int32Array | Float32Array | Float64Array;
/** A column of lists: row i owns values[offsets[i]] to values[offsets[i + 1]]. */
export interface Lists {
  values: Numbers;
  offsets: Numbers;
}
export type Column = Numbers | Lists | string[];
export type Columns = Record<string, Column>;
export type Scalar = null | boolean | number | string;
/** Whose message it is, live: the simulation, and which of its episodes. */
export interface Address {
  source: string;
  serial: number;
}
export interface EpisodeMessage {
  type: "episode";
  facts: Record<string, Scalar>;
  names: Record<string, Record<string, string>>;
  origin: [number, number];
}
export interface MapMessage {
  type: "map";
  bounds: number[];
  lanes: Columns;
  edges: string[];
}
export interface TableMessage {
  type: "table";
  name: string;
  columns: Columns;
  append: boolean;
}
export interface VehiclesMessage {
  type: "vehicles";
  columns: Columns;
}
/** States of K steps, decoded: row r of each column is one vehicle at one step; run i owns `count[i]` rows in turn. */
export interface StepsMessage {
  type: "steps";
  step: Int32Array;
  number: Uint32Array;
  begin: Uint16Array;
  count: Uint16Array;
  x: Int32Array;
  y: Int32Array;
  heading: Int32Array;
  speed: Int32Array;
  steer: Int32Array;
  flags: Uint16Array;
  /** The vehicle of each row. */
  rowNumber: Uint32Array;
}
export interface EndMessage {
  type: "end";
  isComplete: boolean;
  remark: string;
}
export interface Source {
  id: string;
  title: string;
  scenario: string;
  host: string;
  episode: number;
  step: number;
  running: boolean;
  rate: number;
}
export interface SourcesMessage {
  type: "sources";
  sources: Source[];
}
export interface ErrorMessage {
  type: "error";
  text: string;
}
export type Message = Partial<Address> & Body;
type Body =
  | EpisodeMessage
  | MapMessage
  | TableMessage
  | VehiclesMessage
  | StepsMessage
  | EndMessage
  | SourcesMessage
  | ErrorMessage;

/** Decompresses to exactly `length` bytes, and stops reading where there are more. */
async function inflate(bytes: Uint8Array, length: number): Promise<Uint8Array> {
  if (!Number.isInteger(length) || length < 0 || length > LARGEST_ARRAY)
    throw new FormatError("an array is too large");
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

const isMap = (raw: Raw | undefined): raw is RawMap =>
  typeof raw === "object" && raw !== null && !Array.isArray(raw) && !(raw instanceof Uint8Array);

const ARRAYS = {
  u1: Uint8Array,
  i1: Int8Array,
  u2: Uint16Array,
  i2: Int16Array,
  u4: Uint32Array,
  i4: Int32Array,
  f4: Float32Array,
  f8: Float64Array,
} as const;

async function plain(raw: RawMap): Promise<Uint8Array> {
  if (!(raw.d instanceof Uint8Array)) throw new FormatError("an array has no data");
  return raw.z === true ? inflate(raw.d, Number(raw.n)) : raw.d;
}

/** Returns the typed array of `{t, d, z, n}`. */
async function numbers(raw: Raw | undefined): Promise<Numbers> {
  if (!isMap(raw) || typeof raw.t !== "string" || !(raw.d instanceof Uint8Array))
    throw new FormatError("an array has no type or no data");
  const Type = ARRAYS[raw.t as keyof typeof ARRAYS];
  if (!Type) throw new FormatError(`an array has the unknown type ${raw.t}`);
  const bytes = await plain(raw);
  if (bytes.length % Type.BYTES_PER_ELEMENT) throw new FormatError("an array has a broken last value");
  // A copy, since views of the message need not be aligned.
  return new Type(bytes.slice().buffer as ArrayBuffer);
}

async function column(raw: Raw | undefined): Promise<Column> {
  if (Array.isArray(raw)) return raw.map((value) => (value === null ? "" : String(value)));
  const values = await numbers(raw);
  if (!isMap(raw) || raw.o === undefined) return values;
  const offsets = await numbers(raw.o);
  checkOffsets(offsets, values.length);
  return { values, offsets };
}

async function columns(raw: Raw | undefined): Promise<Columns> {
  if (!isMap(raw)) throw new FormatError("a table has no columns");
  const entries = Object.entries(raw).filter(([, value]) => typeof value === "object" && value !== null);
  return Object.fromEntries(
    await Promise.all(entries.map(async ([name, value]) => [name, await column(value)])),
  );
}

/** Checks that rows of lists begin in order, inside their values. */
function checkOffsets(offsets: Numbers, length: number): void {
  for (let i = 0; i < offsets.length; i++)
    if (offsets[i] > length || (i > 0 && offsets[i] < offsets[i - 1]))
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
async function runs(raw: Raw | undefined, counts: Numbers): Promise<Int32Array> {
  if (!isMap(raw) || raw.e !== 1) return Int32Array.from(await numbers(raw));
  const bytes = await plain(raw);
  if (bytes.length % 4) throw new FormatError("an array has a broken last value");
  return integrate(bytes, counts);
}

async function steps(raw: RawMap): Promise<StepsMessage> {
  const [step, number, flags] = await Promise.all([raw.step, raw.number, raw.flags].map(numbers));
  const isOne = raw.count === undefined && step.length === 1;
  const begin = isOne ? new Uint16Array(number.length) : await numbers(raw.begin);
  const count = isOne ? new Uint16Array(number.length).fill(1) : await numbers(raw.count);
  let rows = 0;
  for (const each of count) rows += each;
  checkRuns(step, number, begin, count, rows);
  const [x, y, heading, speed, steer] = await Promise.all(
    [raw.x, raw.y, raw.heading, raw.speed, raw.steer].map((each) => runs(each, count)),
  );
  if ([x, y, heading, speed, steer, flags].some((column) => column.length !== rows))
    throw new FormatError("the columns of states differ in length");
  const rowNumber = new Uint32Array(rows);
  for (let run = 0, row = 0; run < count.length; run++) rowNumber.fill(number[run], row, (row += count[run]));
  return {
    type: "steps",
    step: Int32Array.from(step),
    number: Uint32Array.from(number),
    begin: Uint16Array.from(begin),
    count: Uint16Array.from(count),
    x,
    y,
    heading,
    speed,
    steer,
    flags: Uint16Array.from(flags),
    rowNumber,
  };
}

function checkRuns(step: Numbers, number: Numbers, begin: Numbers, count: Numbers, rows: number): void {
  if (begin.length !== count.length || number.length !== count.length || rows > MOST_ROWS)
    throw new FormatError("the runs of states do not fit together");
  for (let i = 1; i < step.length; i++)
    if (step[i] <= step[i - 1]) throw new FormatError("steps are not in order");
  for (let i = 0; i < count.length; i++) {
    if (number[i] >= MOST_VEHICLES || number[i] < 0)
      throw new FormatError("a recording has too many vehicles");
    if (count[i] < 1 || begin[i] < 0 || begin[i] + count[i] > step.length)
      throw new FormatError("a run is longer than its chunk");
  }
}

/** Returns the columns of lanes; x and y may be packed as differences within lanes. */
async function lanesOf(raw: Raw | undefined): Promise<Columns> {
  if (!isMap(raw)) throw new FormatError("a map has no lanes");
  const { x, y, ...others } = raw;
  const found = await columns(others);
  const start = await numbers(raw.start);
  const counts = Uint32Array.from(start.subarray(1), (end, i) => Math.max(0, end - start[i]));
  const [xs, ys] = await Promise.all([runs(x, counts), runs(y, counts)]);
  checkOffsets(start, Math.min(xs.length, ys.length));
  return { ...found, x: xs, y: ys };
}

function names(raw: Raw | undefined): Record<string, Record<string, string>> {
  const found: Record<string, Record<string, string>> = {};
  for (const [kind, values] of Object.entries(isMap(raw) ? raw : {}))
    found[kind] = Object.fromEntries(
      Object.entries(isMap(values) ? values : {}).map(([k, v]) => [k, String(v)]),
    );
  return found;
}

function source(raw: Raw): Source {
  const each = isMap(raw) ? raw : {};
  const text = (name: string) => (each[name] === undefined || each[name] === null ? "" : String(each[name]));
  return {
    id: text("id"),
    title: text("title"),
    scenario: text("scenario"),
    host: text("host"),
    episode: Number(each.episode),
    step: Number(each.step),
    running: each.running === true,
    rate: Number(each.rate),
  };
}

/** Decodes one message; null for a type that this version does not know. */
export async function decode(bytes: Uint8Array): Promise<(Message & Address) | null> {
  if (bytes.length > LARGEST_MESSAGE) throw new FormatError("a message is larger than 8 MB");
  let raw: Raw;
  try {
    raw = unpack(bytes);
  } catch (error) {
    throw error instanceof FormatError ? error : new FormatError("a message is damaged");
  }
  if (!isMap(raw)) throw new FormatError("a message is not a map");
  const body = await decodeBody(raw);
  return body && { ...body, source: String(raw.source ?? ""), serial: Number(raw.serial ?? 0) };
}

async function decodeBody(raw: RawMap): Promise<Body | null> {
  switch (raw.type) {
    case "episode": {
      if (raw.version !== VERSION)
        throw new FormatError(
          `the recording has version ${String(raw.version)} of the format; this page reads ${VERSION}`,
        );
      const origin = Array.isArray(raw.origin) ? raw.origin.map(Number) : [0, 0];
      const facts = (isMap(raw.facts) ? raw.facts : {}) as Record<string, Scalar>;
      return { type: "episode", facts, names: names(raw.names), origin: [origin[0], origin[1]] };
    }
    case "map": {
      const edges = Array.isArray(raw.edges) ? raw.edges.map(String) : [];
      const bounds = Array.isArray(raw.bounds) ? raw.bounds.map(Number) : [0, 0, 1, 1];
      return { type: "map", bounds, lanes: await lanesOf(raw.lanes), edges };
    }
    case "table":
      return {
        type: "table",
        name: String(raw.name),
        columns: await columns(raw.columns),
        append: raw.append === true,
      };
    case "vehicles": {
      const given = isMap(raw.columns) ? raw.columns : raw;
      return { type: "vehicles", columns: await columns(given) };
    }
    case "steps":
      return steps(raw);
    case "end":
      return { type: "end", isComplete: raw.is_complete === true, remark: String(raw.remark ?? "") };
    case "sources":
      return { type: "sources", sources: (Array.isArray(raw.sources) ? raw.sources : []).map(source) };
    case "error":
      return { type: "error", text: String(raw.text ?? "") };
    default:
      return null;
  }
}

export interface Container {
  messages: Message[];
  /** Why the rest is missing; empty if the file is whole. */
  damage: string;
}

/** Decodes a compact episode; what is cut off or damaged ends the list of messages. */
export async function decodeContainer(bytes: Uint8Array): Promise<Container> {
  const head = String.fromCharCode(...bytes.subarray(0, MAGIC.length));
  if (head !== MAGIC) throw new FormatError("this is not a compact episode");
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const pending: Promise<Message | null>[] = [];
  let damage = "";
  let at = MAGIC.length;
  while (at < bytes.length) {
    const begin = at + 4;
    const size = begin <= bytes.length ? view.getUint32(at, true) : Infinity;
    if (size > LARGEST_MESSAGE && size !== Infinity) damage = "a message is larger than 8 MB";
    else if (begin + size > bytes.length) damage = "the recording is cut off";
    if (damage) break;
    pending.push(decode(bytes.subarray(begin, begin + size)));
    at = begin + size;
  }
  const messages: Message[] = [];
  const results = await Promise.allSettled(pending);
  for (const result of results) {
    if (result.status === "rejected") {
      if (!messages.length) throw result.reason;
      damage = result.reason instanceof Error ? result.reason.message : String(result.reason);
      break;
    }
    if (result.value) messages.push(result.value);
  }
  if (!messages.some((message) => message.type === "episode"))
    throw new FormatError(damage || "the recording is empty");
  return { messages, damage };
}
