/** A recording, as far as it has arrived: the state of all vehicles at any time. No DOM. */

import type { Columns, MapMessage, Message, Scalar, StepsMessage } from "./format";
import { StepIndex, Table } from "./tables";

const MOST_LIVE_CHUNKS = 6000;
export const AIR_LOCK = 1 << 6;
export const COLLIDED = 1 << 8;
const OWNER = 7;
const RETURNING = 1 << 7;
const OWNER_AGENT = 2;
/** Vehicles are not drawn between states that are more steps apart. */
const WIDEST_GAP = 5;

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
      this.agent = new Int32Array(size);
    }
    if (numbers > this.place.length) this.place = new Int32Array(2 * numbers);
    this.place.fill(-1);
  }
}

/** Where the rows of a step lie: rows[i] of the chunk, with the same vehicle's row one step later, or -1. */
interface Frame {
  step: number;
  chunk: StepsMessage;
  rows: Int32Array;
}

export interface Vehicle {
  number: number;
  slot: number;
  generation: number;
  name: string;
  kind: number;
  length: number;
  width: number;
}

export class Recording {
  facts: Record<string, Scalar> = {};
  names: Record<string, Record<string, string>> = {};
  origin: [number, number] = [0, 0];
  map: MapMessage | null = null;
  readonly vehicles: Vehicle[] = [];
  isComplete = false;
  hasEnded = false;
  remark = "";
  /** Counts replaced or extended tables, so that views know when to look again. */
  version = 0;

  private readonly tables = new Map<string, Table>();
  private readonly indices = new Map<string, StepIndex>();
  private readonly frames: Frame[] = [];
  private readonly numberOf = new Map<number, number>();
  private pairs = { at: -1, next: new Int32Array(0) };

  constructor(
    messages: readonly Message[] = [],
    readonly isLive = false,
  ) {
    for (const message of messages) this.add(message);
  }

  add(message: Message): void {
    switch (message.type) {
      case "episode":
        this.facts = message.facts;
        this.names = message.names;
        this.origin = message.origin;
        break;
      case "map":
        this.map = message;
        break;
      case "table":
        this.addTable(message.name, message.columns, message.append);
        break;
      case "vehicles":
        this.addVehicles(new Table(message.columns));
        break;
      case "steps":
        this.addSteps(message);
        break;
      case "end":
        this.isComplete = message.isComplete;
        this.hasEnded = true;
        this.remark = message.remark;
        break;
    }
  }

  get dt(): number {
    const dt = Number(this.facts.dt);
    return dt > 0 ? dt : 0.1;
  }

  get firstStep(): number {
    return this.frames.length ? this.frames[0].step : 0;
  }

  get lastStep(): number {
    return this.frames.length ? this.frames[this.frames.length - 1].step : 0;
  }

  /** The number of steps with states. */
  get length(): number {
    return this.frames.length;
  }

  table(name: string): Table {
    return this.tables.get(name) ?? EMPTY;
  }

  /** Rows of a table by one of its columns. */
  index(name: string, key: string): StepIndex {
    const id = `${name}.${key}`;
    let index = this.indices.get(id);
    if (!index) this.indices.set(id, (index = new StepIndex(this.table(name), key)));
    return index;
  }

  vehicleNumber(slot: number, generation: number): number {
    return this.numberOf.get(slot * 0x100000 + generation) ?? -1;
  }

  private addTable(name: string, columns: Columns, append: boolean): void {
    const table = this.tables.get(name);
    if (table && append) table.append(columns);
    else {
      this.tables.set(name, new Table(columns));
      for (const id of this.indices.keys()) if (id.startsWith(`${name}.`)) this.indices.delete(id);
    }
    this.version++;
  }

  private addVehicles(table: Table): void {
    const [numbers, slots, generations] = ["number", "slot", "generation"].map((name) => table.numbers(name));
    const [kinds, lengths, widths] = ["kind", "length", "width"].map((name) => table.numbers(name));
    const texts = table.texts("name");
    for (let row = 0; row < table.rows; row++) {
      const number = numbers[row];
      this.vehicles[number] = {
        number,
        slot: slots[row],
        generation: generations[row],
        name: texts[row] ?? "",
        kind: kinds[row] ?? 0,
        length: lengths[row] ?? 4.5,
        width: widths[row] ?? 1.8,
      };
      this.numberOf.set(slots[row] * 0x100000 + generations[row], number);
    }
  }

  private addSteps(chunk: StepsMessage): void {
    const count = new Int32Array(chunk.step.length);
    chunk.begin.forEach((begin, run) => {
      for (let i = 0; i < chunk.count[run]; i++) count[begin + i]++;
    });
    const rows = Array.from(count, (size) => new Int32Array(size));
    count.fill(0);
    let row = 0;
    chunk.begin.forEach((begin, run) => {
      for (let i = 0; i < chunk.count[run]; i++) rows[begin + i][count[begin + i]++] = row++;
    });
    chunk.step.forEach((step, i) => {
      if (!this.frames.length || step > this.lastStep) this.frames.push({ step, chunk, rows: rows[i] });
    });
    if (this.isLive && this.frames.length > MOST_LIVE_CHUNKS) {
      this.frames.splice(0, MOST_LIVE_CHUNKS / 2);
      this.pairs.at = -1;
    }
  }

  /** The place of the newest frame at or before the step. */
  private frameAt(step: number): number {
    let low = 0;
    let high = this.frames.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.frames[middle].step <= step) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /** Finds, for each row of frame `at`, the row of the same vehicle in the next frame. */
  private pair(at: number): Int32Array {
    if (this.pairs.at === at && this.pairs.next.length === this.frames[at].rows.length)
      return this.pairs.next;
    const frame = this.frames[at];
    const next = new Int32Array(frame.rows.length).fill(-1);
    const after = this.frames[at + 1];
    if (after) {
      const rowOf = new Map<number, number>();
      for (const row of after.rows) rowOf.set(after.chunk.rowNumber[row], row);
      frame.rows.forEach((row, i) => (next[i] = rowOf.get(frame.chunk.rowNumber[row]) ?? -1));
      this.pairs = { at, next };
    }
    return next;
  }

  /** Fills `out` with the vehicles at a time given in steps, interpolated. */
  sample(step: number, out: Snapshot): void {
    out.count = 0;
    if (!this.frames.length) return;
    const at = this.frameAt(step);
    const { chunk: a, rows, step: first } = this.frames[at];
    const after = this.frames[at + 1];
    const next = this.pair(at);
    const b = after ? after.chunk : a;
    const gap = after ? after.step - first : 0;
    const whole = gap && gap <= WIDEST_GAP ? Math.min(1, Math.max(0, (step - first) / gap)) : 0;
    out.reserve(rows.length, this.vehicles.length);
    for (let i = 0; i < rows.length; i++) {
      const row = rows[i];
      const other = next[i] < 0 ? row : next[i];
      const source = next[i] < 0 ? a : b;
      const number = a.rowNumber[row];
      const reach = 2 * a.speed[row] * this.dt * gap + 100;
      const part = Math.hypot(source.x[other] - a.x[row], source.y[other] - a.y[row]) <= reach ? whole : 0;
      out.number[i] = number;
      out.x[i] = 0.01 * (a.x[row] + part * (source.x[other] - a.x[row]));
      out.y[i] = 0.01 * (a.y[row] + part * (source.y[other] - a.y[row]));
      // Runs of two chunks may differ by whole turns.
      const turn = source.heading[other] - a.heading[row];
      const short = turn - 3600 * Math.round(turn / 3600);
      out.heading[i] = ((a.heading[row] + part * short) * Math.PI) / 1800;
      out.speed[i] = 0.01 * (a.speed[row] + part * (source.speed[other] - a.speed[row]));
      out.steer[i] = ((a.steer[row] + part * (source.steer[other] - a.steer[row])) * Math.PI) / 1800;
      const flags = a.flags[row];
      out.flags[i] = flags;
      out.agent[i] = -1;
      const owner = flags & OWNER;
      out.driver[i] =
        flags & RETURNING
          ? Driver.Fallback
          : owner === OWNER_AGENT
            ? Driver.Ego
            : owner <= 1
              ? Driver.Traffic
              : Driver.Other;
      out.place[number] = i;
    }
    out.count = rows.length;
    this.assign(first, out);
  }

  /** The speed of a vehicle in the state after so many steps [m/s]; NaN where it is not there. */
  speedAt(number: number, step: number): number {
    if (!this.frames.length) return NaN;
    const { chunk, rows, step: found } = this.frames[this.frameAt(step)];
    if (found !== step) return NaN;
    for (const row of rows) if (chunk.rowNumber[row] === number) return 0.01 * chunk.speed[row];
    return NaN;
  }

  /** The path of a vehicle over the last steps up to `step`, oldest first, as x, y in turn [m]. */
  trail(number: number, step: number, steps: number, out: number[]): void {
    out.length = 0;
    if (!this.frames.length) return;
    const last = this.frameAt(step);
    for (let at = Math.max(0, last - steps); at <= last; at++) {
      const { chunk, rows } = this.frames[at];
      const row = rows.find((each) => chunk.rowNumber[each] === number);
      if (row !== undefined) out.push(0.01 * chunk.x[row], 0.01 * chunk.y[row]);
    }
  }

  /** Writes which agent has which vehicle at the step. */
  private assign(step: number, out: Snapshot): void {
    const states = this.table("agent_states");
    const steps = states.numbers("step");
    const [slots, generations] = [states.numbers("slot"), states.numbers("generation")];
    const interfaces = this.table("agents").numbers("interface");
    const index = this.index("agent_states", "agent");
    for (const agent of index.keys()) {
      const row = agent < 0 ? -1 : index.at(agent, step);
      if (row < 0 || steps[row] !== step) continue;
      const place = out.place[this.vehicleNumber(slots[row], generations[row])] ?? -1;
      if (place < 0) continue;
      out.agent[place] = agent;
      if (out.driver[place] !== Driver.Ego) continue;
      if (this.hasFailed(agent, step)) out.driver[place] = Driver.Fallback;
      else if (interfaces[agent] >= 0) out.driver[place] = Driver.Social;
    }
  }

  private hasFailed(agent: number, step: number): boolean {
    const failures = this.table("agent_failures");
    const [agents, steps] = [failures.numbers("agent"), failures.numbers("step")];
    for (let row = 0; row < failures.rows; row++)
      if (agents[row] === agent && steps[row] <= step) return true;
    return false;
  }
}

const EMPTY = new Table();
