/** A recording, as far as it has arrived: the state of all vehicles at any time. No DOM. */

import { type Chunk, Chunks, ROW_BYTES, rowOf, type States } from "./chunks";
import { MOST_VEHICLES } from "./format";
import type { Columns, MapMessage, Message, Scalar, StepsMessage } from "./messages";
import { Driver, OWNER, OWNER_AGENT, RETURNING, type Snapshot } from "./snapshot";
import { StepIndex, Table } from "./tables";

/** Of what is live, the past is forgotten beyond this: at 60 frames a second two minutes. */
const MOST_LIVE_FRAMES = 8000;
/** Of a frame beside its rows: its arrays themselves. */
const FRAME_BYTES = 2000;
/** Tables whose rows hold until the next one of the same key. */
const LASTING: Record<string, string> = { signals: "lane", bubble_poses: "bubble" };
const PASSING = ["agent_states", "decisions", "extras", "observations", ...Object.keys(LASTING)];
/** Vehicles are not drawn between states that are more steps apart. */
const WIDEST_GAP = 5;
const GENERATIONS = 2 ** 32;

/** Where the states of a step lie: step number `place` of a chunk. */
interface Frame {
  step: number;
  chunk: Chunk;
  place: number;
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

export interface Box {
  x0: number;
  y0: number;
  x1: number;
  y1: number;
}

export class Recording {
  facts: Record<string, Scalar> = {};
  names: Record<string, Record<string, string>> = {};
  origin: [number, number] = [0, 0];
  map: MapMessage | null = null;
  readonly vehicles: (Vehicle | undefined)[] = [];
  /** Where agents have driven [m]. */
  readonly reach: Box = { x0: Infinity, y0: Infinity, x1: -Infinity, y1: -Infinity };
  isComplete = false;
  hasEnded = false;
  remark = "";
  /** Counts replaced or extended tables, so that views know when to look again. */
  version = 0;

  private readonly tables = new Map<string, Table>();
  private readonly indices = new Map<string, StepIndex>();
  private readonly frames: Frame[] = [];
  private rows = 0;
  private readonly numberOf = new Map<number, number>();
  /** The speed of the vehicle of each row of agent_states [m/s]. */
  private speeds: number[] = [];
  private pairs: { at: Frame | null; after: Frame | null; next: Int32Array } = {
    at: null,
    after: null,
    next: new Int32Array(0),
  };

  constructor(
    messages: readonly Message[] = [],
    readonly isLive = false,
    readonly chunks = new Chunks(),
  ) {
    for (const message of messages) this.add(message);
  }

  /** Takes up a message; of states whose bytes are given, some are dropped and decoded again when needed. */
  add(message: Message, packed: Uint8Array | null = null): void {
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
        this.addSteps(message, packed);
        break;
      case "end":
        this.isComplete = message.isComplete;
        this.hasEnded = true;
        this.remark = message.remark;
        this.version++;
        break;
    }
  }

  get dt(): number {
    const dt = Number(this.facts.dt);
    return dt > 1e-4 && dt < 1e4 ? dt : 0.1;
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
    return this.numberOf.get(slot * GENERATIONS + generation) ?? -1;
  }

  private addTable(name: string, columns: Columns, append: boolean): void {
    const table = this.tables.get(name);
    if (table && append) table.append(columns);
    else this.replace(name, new Table(columns));
    this.version++;
  }

  private replace(name: string, table: Table): void {
    this.tables.set(name, table);
    for (const id of this.indices.keys()) if (id.startsWith(`${name}.`)) this.indices.delete(id);
    if (name === "agent_states") this.speeds = [];
  }

  private addVehicles(table: Table): void {
    const [numbers, slots, generations] = ["number", "slot", "generation"].map((name) => table.numbers(name));
    const [kinds, lengths, widths] = ["kind", "length", "width"].map((name) => table.numbers(name));
    const texts = table.texts("name");
    for (let row = 0; row < table.rows; row++) {
      const number = numbers[row];
      if (!(number >= 0 && number < MOST_VEHICLES && Number.isInteger(number))) continue;
      // Numbers without a vehicle would make holes, in which arrays are slow.
      while (this.vehicles.length < number) this.vehicles.push(undefined);
      this.vehicles[number] = {
        number,
        slot: slots[row],
        generation: generations[row],
        name: texts[row] ?? "",
        kind: kinds[row] ?? 0,
        length: size(lengths[row], 4.5),
        width: size(widths[row], 1.8),
      };
      this.numberOf.set(slots[row] * GENERATIONS + generations[row], number);
    }
  }

  private addSteps(message: StepsMessage, packed: Uint8Array | null): void {
    const chunk = this.chunks.add(message, packed);
    const states = this.chunks.get(chunk);
    message.step.forEach((step, place) => {
      if (!this.frames.length || step > this.lastStep) this.frames.push({ step, chunk, place });
    });
    this.rows += message.flags.length;
    if (states) this.takeSpeeds(states);
    if (this.isLive && this.frames.length > MOST_LIVE_FRAMES) this.forget();
  }

  /** Notes the speeds of agents' vehicles, and where they are, so that no other states are needed for them. */
  private takeSpeeds(states: States): void {
    const table = this.table("agent_states");
    const [steps, slots, generations] = ["step", "slot", "generation"].map((name) => table.numbers(name));
    const { reach } = this;
    for (let row = this.speeds.length; row < table.rows; row++) {
      const place = states.step.indexOf(steps[row]);
      if (place < 0 && steps[row] > states.step[states.step.length - 1]) break;
      const number = this.vehicleNumber(slots[row], generations[row]);
      const at = place < 0 || number < 0 ? -1 : rowOf(states, place, number);
      this.speeds.push(at < 0 ? NaN : 0.01 * states.speed[at]);
      if (at < 0) continue;
      const [x, y] = [0.01 * states.x[at], 0.01 * states.y[at]];
      reach.x0 = Math.min(reach.x0, x);
      reach.y0 = Math.min(reach.y0, y);
      reach.x1 = Math.max(reach.x1, x);
      reach.y1 = Math.max(reach.y1, y);
    }
  }

  /** About how much memory the states take, where none are decoded again. */
  get bytes(): number {
    return ROW_BYTES * this.rows + FRAME_BYTES * this.frames.length;
  }

  /** Forgets the older half of what is live. */
  forget(): void {
    this.frames.splice(0, this.frames.length >> 1);
    this.rows = this.frames.reduce((sum, { chunk }) => sum + (chunk.states?.flags.length ?? 0), 0);
    const first = this.firstStep;
    for (const name of PASSING) {
      const table = this.tables.get(name);
      if (!table) continue;
      const steps = table.numbers("step");
      const kept = new Set<number>();
      const key = LASTING[name];
      for (const each of key ? this.index(name, key).keys() : []) {
        const last = this.index(name, key).at(each, first);
        if (last >= 0) kept.add(last);
      }
      const rows: number[] = [];
      for (let row = 0; row < table.rows; row++) if (steps[row] >= first || kept.has(row)) rows.push(row);
      const speeds = name === "agent_states" ? rows.filter((row) => row < this.speeds.length) : [];
      const ofRows = speeds.map((row) => this.speeds[row]);
      this.replace(name, table.kept(rows));
      if (name === "agent_states") this.speeds = ofRows;
    }
    this.version++;
  }

  /** The speed of the vehicle of a row of agent_states [m/s]; NaN where it is not known. */
  speedOf(row: number): number {
    return this.speeds[row] ?? NaN;
  }

  /** The number of the newest frame at or before the step. */
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

  /** Finds, for each row of a frame, the row of the same vehicle in the next frame, -1 where it is gone. */
  private pair(at: Frame, after: Frame | undefined, a: States, b: States | null): Int32Array {
    if (this.pairs.at === at && this.pairs.after === after) return this.pairs.next;
    const rows = a.rows[at.place];
    const next = new Int32Array(rows.length).fill(-1);
    if (!after || !b) return next;
    const others = b.rows[after.place];
    for (let i = 0, k = 0; i < rows.length; i++) {
      const number = a.rowNumber[rows[i]];
      while (k < others.length && b.rowNumber[others[k]] < number) k++;
      if (k < others.length && b.rowNumber[others[k]] === number) next[i] = others[k];
    }
    this.pairs = { at, after, next };
    return next;
  }

  /** Fills `out` with the vehicles at a time given in steps, interpolated.

  Returns false, and leaves `out` as it is, where the states have to be decoded first: `chunks.onArrival` says when. */
  sample(step: number, out: Snapshot): boolean {
    if (!this.frames.length) {
      out.count = 0;
      return true;
    }
    const at = this.frameAt(step);
    const frame = this.frames[at];
    const after = this.frames[at + 1];
    const a = this.chunks.get(frame.chunk);
    const b = after ? this.chunks.get(after.chunk) : null;
    // Those that come next are decoded before they are needed.
    const soon = this.frames[Math.min(this.frames.length - 1, at + (a?.step.length ?? 0))];
    if (soon.chunk !== frame.chunk) this.chunks.get(soon.chunk);
    if (!a) return false;
    const gap = after && b ? after.step - frame.step : 0;
    const part = gap && gap <= WIDEST_GAP ? Math.min(1, Math.max(0, (step - frame.step) / gap)) : 0;
    this.fill(a, b ?? a, a.rows[frame.place], this.pair(frame, after, a, b), part, gap * this.dt, out);
    this.assign(frame.step, out);
    return true;
  }

  /** Fills `out` with rows of states, moved by a part of the way to the rows `next` of `b`, `gap` seconds later. */
  private fill(
    a: States,
    b: States,
    rows: Int32Array,
    next: Int32Array,
    part: number,
    gap: number,
    out: Snapshot,
  ): void {
    out.reserve(rows.length, this.vehicles.length);
    for (let i = 0; i < rows.length; i++) {
      const row = rows[i];
      const to = next[i] < 0 ? a : b;
      const other = next[i] < 0 ? row : next[i];
      const number = a.rowNumber[row];
      const [dx, dy] = [to.x[other] - a.x[row], to.y[other] - a.y[row]];
      // A vehicle that is moved by the simulation jumps.
      const reach = 2 * Math.abs(a.speed[row]) * gap + 100;
      const share = dx * dx + dy * dy <= reach * reach ? part : 0;
      // Runs of two chunks may differ by whole turns.
      const turn = to.heading[other] - a.heading[row];
      const short = turn - 3600 * Math.round(turn / 3600);
      out.number[i] = number;
      out.x[i] = 0.01 * (a.x[row] + share * dx);
      out.y[i] = 0.01 * (a.y[row] + share * dy);
      out.heading[i] = ((a.heading[row] + share * short) * Math.PI) / 1800;
      out.speed[i] = 0.01 * (a.speed[row] + share * (to.speed[other] - a.speed[row]));
      out.steer[i] = ((a.steer[row] + share * (to.steer[other] - a.steer[row])) * Math.PI) / 1800;
      out.flags[i] = a.flags[row];
      out.agent[i] = -1;
      out.driver[i] = driverOf(a.flags[row]);
      out.place[number] = i;
    }
    out.count = rows.length;
  }

  /** The path of a vehicle over the last steps up to `step`, oldest first, as x, y in turn [m]. */
  trail(number: number, step: number, steps: number, out: number[]): void {
    out.length = 0;
    if (!this.frames.length) return;
    const last = this.frameAt(step);
    for (let at = Math.max(0, last - steps); at <= last; at++) {
      const { chunk, place } = this.frames[at];
      const states = this.chunks.get(chunk);
      const row = states ? rowOf(states, place, number) : -1;
      if (states && row >= 0) out.push(0.01 * states.x[row], 0.01 * states.y[row]);
    }
  }

  /** Where an agent's vehicle is at a step: x, y [m] and heading [rad]; null where that is not known, or not yet. */
  poseOf(agent: number, step: number): [number, number, number] | null {
    const table = this.table("agent_states");
    const of = this.index("agent_states", "agent").at(agent, step);
    if (of < 0 || table.numbers("step")[of] !== step || !this.frames.length) return null;
    const number = this.vehicleNumber(table.numbers("slot")[of], table.numbers("generation")[of]);
    const frame = this.frames[this.frameAt(step)];
    const states = frame.step === step ? this.chunks.get(frame.chunk) : null;
    const row = states ? rowOf(states, frame.place, number) : -1;
    if (!states || row < 0) return null;
    return [0.01 * states.x[row], 0.01 * states.y[row], (states.heading[row] * Math.PI) / 1800];
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

function driverOf(flags: number): Driver {
  const owner = flags & OWNER;
  if (flags & RETURNING) return Driver.Fallback;
  return owner === OWNER_AGENT ? Driver.Ego : owner <= 1 ? Driver.Traffic : Driver.Other;
}

const size = (metres: number | undefined, otherwise: number): number =>
  metres !== undefined && metres > 0 && metres < 100 ? metres : otherwise;

const EMPTY = new Table();
