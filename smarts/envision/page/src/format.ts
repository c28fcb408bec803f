/** Decodes the messages that a compact episode, an HTTP answer and a WebSocket carry. No DOM. */

import {
  Budget,
  checkOffsets,
  columns,
  integers,
  isMap,
  numberOf,
  runs,
  textOf,
} from "./arrays";
import type { Address, Body, Columns, Message, Numbers, Scalar, Source, StepsMessage } from "./messages";
import { FormatError, type Raw, type RawMap, unpack } from "./msgpack";

export const VERSION = 1;
export const LARGEST_MESSAGE = 8 << 20;
const MOST_ROWS = 1_000_000;
export const MOST_VEHICLES = 1 << 20;

async function steps(raw: RawMap): Promise<StepsMessage> {
  const budget = new Budget();
  const whole = (each: Raw | undefined) => integers(each, budget);
  const [step, number, flags] = await Promise.all([raw.step, raw.number, raw.flags].map(whole));
  const isOne = raw.count === undefined && step.length === 1;
  const begin = isOne ? new Uint16Array(number.length) : await whole(raw.begin);
  const count = isOne ? new Uint16Array(number.length).fill(1) : await whole(raw.count);
  const rows = checkRuns(step, number, begin, count);
  const [x, y, heading, speed, steer] = await Promise.all(
    [raw.x, raw.y, raw.heading, raw.speed, raw.steer].map((each) => runs(each, count, budget)),
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

/** Checks that steps are in order, and runs in order of vehicle and step; returns the number of rows. */
function checkRuns(step: Numbers, number: Numbers, begin: Numbers, count: Numbers): number {
  if (begin.length !== count.length || number.length !== count.length)
    throw new FormatError("the runs of states do not fit together");
  for (let i = 0; i < step.length; i++)
    if (step[i] < 0 || (i && step[i] <= step[i - 1])) throw new FormatError("steps are not in order");
  let rows = 0;
  for (let i = 0; i < count.length; i++) {
    if (number[i] >= MOST_VEHICLES || number[i] < 0)
      throw new FormatError("a recording has too many vehicles");
    if (count[i] < 1 || begin[i] < 0 || begin[i] + count[i] > step.length)
      throw new FormatError("a run is longer than its chunk");
    if (i && (number[i] < number[i - 1] || (number[i] === number[i - 1] && begin[i] < begin[i - 1] + count[i - 1])))
      throw new FormatError("the runs of states are not in order");
    rows += count[i];
    if (rows > MOST_ROWS) throw new FormatError(`a message has more than ${MOST_ROWS} states`);
  }
  return rows;
}

/** Returns the columns of lanes; x and y may be packed as differences within lanes. */
async function lanesOf(raw: Raw | undefined): Promise<Columns> {
  if (!isMap(raw)) throw new FormatError("a map has no lanes");
  const budget = new Budget();
  const { x, y, ...others } = raw;
  const found = await columns(others, budget);
  const start = await integers(raw.start, budget);
  const counts = Uint32Array.from(start.subarray(1), (end, i) => Math.max(0, end - start[i]));
  const [xs, ys] = await Promise.all([runs(x, counts, budget), runs(y, counts, budget)]);
  checkOffsets(start, Math.min(xs.length, ys.length));
  return Object.assign(found, { start, x: xs, y: ys });
}

function names(raw: Raw | undefined): Record<string, Record<string, string>> {
  const found = Object.create(null) as Record<string, Record<string, string>>;
  for (const [kind, values] of Object.entries(isMap(raw) ? raw : {})) {
    found[kind] = Object.create(null) as Record<string, string>;
    for (const [key, name] of Object.entries(isMap(values) ? values : {})) found[kind][key] = textOf(name);
  }
  return found;
}

/** Returns the facts that are texts, numbers and truth values. */
function facts(raw: Raw | undefined): Record<string, Scalar> {
  const found = Object.create(null) as Record<string, Scalar>;
  for (const [name, value] of Object.entries(isMap(raw) ? raw : {}))
    if (value === null || typeof value !== "object") found[name] = value;
  return found;
}

function finite(raw: Raw | undefined, otherwise: number[]): number[] {
  if (!Array.isArray(raw)) return otherwise;
  return otherwise.map((each, i) => (Number.isFinite(numberOf(raw[i])) ? numberOf(raw[i]) : each));
}

function source(raw: Raw): Source {
  const each = isMap(raw) ? raw : {};
  return {
    id: textOf(each.id),
    title: textOf(each.title),
    scenario: textOf(each.scenario),
    policy: textOf(each.policy),
    host: textOf(each.host),
    world: numberOf(each.world),
    episode: numberOf(each.episode),
    step: numberOf(each.step),
    running: each.running === true,
    rate: numberOf(each.rate),
  };
}

/** Decodes one message; null for a type that this version does not know.

Throws FormatError, whatever is wrong with the bytes. */
export async function decode(bytes: Uint8Array): Promise<(Message & Address) | null> {
  if (bytes.length > LARGEST_MESSAGE) throw new FormatError("a message is larger than 8 MB");
  const raw = unpack(bytes);
  if (!isMap(raw)) throw new FormatError("a message is not a map");
  const body = await decodeBody(raw);
  return body && { ...body, source: textOf(raw.source), serial: numberOf(raw.serial) || 0 };
}

async function decodeBody(raw: RawMap): Promise<Body | null> {
  switch (raw.type) {
    case "episode": {
      if (raw.version !== VERSION)
        throw new FormatError(
          `the recording has version ${textOf(raw.version) || "none"} of the format; this page reads ${VERSION}`,
        );
      const [x, y] = finite(raw.origin, [0, 0]);
      return { type: "episode", facts: facts(raw.facts), names: names(raw.names), origin: [x, y] };
    }
    case "map": {
      const edges = Array.isArray(raw.edges) ? raw.edges.map(textOf) : [];
      const digest = textOf(raw.digest);
      return { type: "map", digest, bounds: finite(raw.bounds, [0, 0, 1, 1]), lanes: await lanesOf(raw.lanes), edges };
    }
    case "known_map":
      return { type: "known_map", digest: textOf(raw.digest) };
    case "table": {
      const found = await columns(raw.columns, new Budget());
      return { type: "table", name: textOf(raw.name), columns: found, append: raw.append === true };
    }
    case "vehicles":
      return { type: "vehicles", columns: await columns(raw, new Budget()) };
    case "steps":
      return steps(raw);
    case "end":
      return { type: "end", isComplete: raw.is_complete === true, remark: textOf(raw.remark) };
    case "sources":
      return {
        type: "sources",
        sources: (Array.isArray(raw.sources) ? raw.sources : []).map(source),
        hidden: Math.max(0, numberOf(raw.hidden) || 0),
      };
    default:
      return null;
  }
}
