/** What a recording says of its agents: outcomes, events, decisions, rewards. No DOM. */

import type { Recording } from "./episode";
import type { Numbers } from "./messages";

const SHADOWING = 2;
const EVENT_WORDS: Record<string, string> = {
  COLLISION: "collision",
  OFF_ROAD: "off the road",
  OFF_ROUTE: "off the route",
  ON_SHOULDER: "on the shoulder",
  WRONG_WAY: "wrong way",
  NOT_MOVING: "not moving",
  REACHED_GOAL: "goal",
  MISSED_GOAL: "missed the goal",
  REACHED_MAX_EPISODE_STEPS: "time out",
  VIA_HIT: "via point",
  LAP_COMPLETED: "lap",
  LEFT_BUBBLE: "left the bubble",
};
const OUTCOME_WORDS: Record<string, string> = {
  NONE: "under way",
  COLLISION: "collision",
  OFF_ROAD: "off the road",
  OFF_ROUTE: "off the route",
  MISSED_GOAL: "missed the goal",
  GOAL: "goal",
  NOT_MOVING: "not moving",
  TIME_OUT: "time out",
  OTHER: "ended with others",
  OTHER_TERMINAL: "wrong way",
  INVALID: "invalid",
  LEFT_BUBBLE: "left the bubble",
};

/** The value of a key that may come from a file, where "constructor" is no key. */
const known = <T>(table: Readonly<Record<string, T>>, key: string): T | undefined =>
  Object.hasOwn(table, key) ? table[key] : undefined;

export type Tone = "good" | "bad" | "warn" | "bubble" | "plain";
export interface Marker {
  step: number;
  text: string;
  tone: Tone;
  /** Row in agents, -1 for none. */
  agent: number;
}

export interface Agent {
  row: number;
  id: number;
  name: string;
  isEgo: boolean;
  entryStep: number;
  endStep: number;
  outcome: string;
  outcomeText: string;
  tone: Tone;
  goal: { x: number; y: number; radius: number } | null;
  route: number;
  /** What ended it in a collision: the other vehicle's name. */
  partner: string;
}

export interface AgentState {
  vehicle: number;
  status: string;
  isShadowing: boolean;
  throttle: number;
  brake: number;
  steering: number;
  progress: number;
  remaining: number;
  /** Of the vehicle [m/s]; NaN where it is not known. */
  speed: number;
  change: string;
}

interface Part {
  name: string;
  value: number;
  low: number;
  high: number;
}

export interface Decision {
  step: number;
  kind: string;
  /** Index of the discrete action, -1 for a continuous one. */
  choice: number;
  labels: string[];
  probabilities: number[] | null;
  /** Of the parts of a continuous action, in their units, where they were recorded. */
  means: number[] | null;
  deviations: number[] | null;
  /** Continuous parts: name, value and the range of values. */
  parts: Part[];
  isLegal: boolean[];
}

export interface Series {
  name: string;
  steps: number[];
  values: number[];
}

export function outcomeTone(outcome: string): Tone {
  if (outcome === "GOAL") return "good";
  if (outcome === "NONE" || outcome === "OTHER" || outcome === "LEFT_BUBBLE") return "plain";
  return outcome === "TIME_OUT" || outcome === "NOT_MOVING" || outcome === "MISSED_GOAL" ? "warn" : "bad";
}

export const outcomeText = (outcome: string): string =>
  known(OUTCOME_WORDS, outcome.toUpperCase()) ?? outcome.toLowerCase().replaceAll("_", " ");

function named(recording: Recording, kind: string, value: number | undefined): string {
  return value === undefined ? "" : (recording.names[kind]?.[String(value)] ?? String(value));
}

export function agentsOf(recording: Recording): Agent[] {
  const table = recording.table("agents");
  const column = (name: string) => table.numbers(name);
  const names = table.texts("name");
  const agents: Agent[] = [];
  const ends = endsOf(recording);
  for (let row = 0; row < table.rows; row++) {
    const end = ends.get(row);
    const outcome = named(recording, "Outcome", end?.outcome ?? column("outcome")[row]) || "NONE";
    const goalKind = named(recording, "GoalKind", column("goal")[row]);
    const [x, y] = [column("goal_x")[row] - recording.origin[0], column("goal_y")[row] - recording.origin[1]];
    const hasGoal =
      goalKind !== "ENDLESS" && Number.isFinite(x) && Number.isFinite(y) && column("interface")[row] < 0;
    agents.push({
      row,
      id: column("agent_id")[row] ?? -1,
      name: names[row] ?? `agent ${row}`,
      isEgo: (column("interface")[row] ?? -1) < 0,
      entryStep: column("entry_step")[row] ?? 0,
      endStep: end?.step ?? column("end_step")[row] ?? -1,
      outcome,
      outcomeText: outcomeText(outcome),
      tone: outcomeTone(outcome),
      goal: hasGoal ? { x, y, radius: column("goal_radius")[row] || 2 } : null,
      route: column("route")[row] ?? -1,
      partner: outcome === "COLLISION" ? table.texts("partner")[row] || end?.partner || "" : "",
    });
  }
  return agents;
}

/** Returns where the egos of a recording start: x, y of each [cm]. */
export function startsOf(recording: Recording): [number, number][] {
  const table = recording.table("agents");
  const [x, y, interfaces] = ["start_x", "start_y", "interface"].map((name) => table.numbers(name));
  const starts: [number, number][] = [];
  for (let row = 0; row < Math.min(table.rows, x.length, y.length); row++)
    if (!(interfaces[row] >= 0)) starts.push([Math.round(100 * x[row]), Math.round(100 * y[row])]);
  return starts;
}

/** Returns what the table outcomes says, by row of agents. */
function endsOf(recording: Recording): Map<number, { step: number; outcome: number; partner: string }> {
  const table = recording.table("outcomes");
  const [agents, steps, outcomes, slots, generations] = [
    "agent",
    "step",
    "outcome",
    "partner_slot",
    "partner_generation",
  ].map((name) => table.numbers(name));
  const ends = new Map<number, { step: number; outcome: number; partner: string }>();
  for (let row = 0; row < table.rows; row++) {
    const partner = recording.vehicles[recording.vehicleNumber(slots[row], generations[row])]?.name ?? "";
    ends.set(agents[row], { step: steps[row], outcome: outcomes[row], partner });
  }
  return ends;
}

/** Returns the agent's state at a step, or null where it has no vehicle. */
export function stateOf(recording: Recording, agent: Agent, step: number): AgentState | null {
  const table = recording.table("agent_states");
  const row = recording.index("agent_states", "agent").at(agent.row, step);
  if (row < 0) return null;
  const value = (name: string) => table.numbers(name)[row] ?? NaN;
  if (agent.endStep >= 0 && step > agent.endStep) return null;
  return {
    vehicle: recording.vehicleNumber(value("slot"), value("generation")),
    status: named(recording, "AgentStatus", value("state")).toLowerCase(),
    isShadowing: value("state") === SHADOWING,
    throttle: value("throttle"),
    brake: value("brake"),
    steering: value("steering"),
    progress: value("route_progress"),
    remaining: value("remaining"),
    speed: recording.speedOf(row),
    change: named(recording, "ChangePhase", value("change_phase")).toLowerCase(),
  };
}

/** The parts of continuous actions, with the range that their distributions count as -1 to 1. */
const CONTINUOUS: Record<string, [string, number, number][]> = {
  Continuous: [
    ["throttle", 0, 1],
    ["brake", 0, 1],
    ["steering", -1, 1],
  ],
  ActuatorDynamic: [
    ["throttle", 0, 1],
    ["brake", 0, 1],
    ["steering rate", -1, 1],
  ],
  LaneWithContinuousSpeed: [
    ["target speed", 0, 60],
    ["lane change", -1, 1],
  ],
  RelativeTargetPose: [
    ["change of x", -6, 6],
    ["change of y", -6, 6],
    ["change of heading", -Math.PI, Math.PI],
  ],
};

/** Returns the last decision of the agent at or before a step, with its distribution where it was recorded. */
export function decisionOf(recording: Recording, agent: Agent, step: number): Decision | null {
  const table = recording.table("decisions");
  const row = recording.index("decisions", "agent").at(agent.row, step);
  const taken = table.numbers("step")[row];
  if (row < 0 || taken < agent.entryStep) return null;
  const kind = named(recording, "ActionSpaceType", table.numbers("action")[row]);
  const isDiscrete = kind === "Lane";
  const labels = Object.values(recording.names.LaneAction ?? {}).map((name) => name.replaceAll("_", " "));
  const mask = table.numbers("action_mask")[row] ?? -1;
  const values = Array.from({ length: 8 }, (_, i) => table.numbers(`value_${i}`)[row]);
  const probabilities = extraAt(recording, agent, "probabilities", taken);
  const range = isDiscrete ? [] : parts(kind, values);
  const distribution = (name: string, scaled: (part: Part, number: number) => number): number[] | null => {
    const numbers = isDiscrete ? null : extraAt(recording, agent, name, taken);
    // Those of an agent that acts otherwise than its vehicle is told are of something else.
    return numbers?.length === range.length ? range.map((part, i) => scaled(part, numbers[i])) : null;
  };
  return {
    step: taken,
    kind,
    choice: isDiscrete ? Math.round(values[0]) : -1,
    labels: isDiscrete ? labels : [],
    probabilities: probabilities && isDiscrete ? Array.from(probabilities) : null,
    means: distribution("mean", ({ low, high }, mean) => low + ((mean + 1) * (high - low)) / 2),
    deviations: distribution("std", ({ low, high }, deviation) => (deviation * (high - low)) / 2),
    parts: range,
    isLegal: labels.map((_, i) => ((mask >> i) & 1) === 1),
  };
}

function parts(kind: string, values: number[]): Part[] {
  const named = known(CONTINUOUS, kind) ?? values.map((_, i) => [`value ${i}`, -1, 1] as [string, number, number]);
  return named
    .map(([name, low, high], i) => ({ name, value: values[i], low, high }))
    .filter((part) => Number.isFinite(part.value));
}

/** Extras that say how an action was chosen; the panel shows them with the action. */
const DISTRIBUTION = ["probabilities", "mean", "std"];

function extraAt(recording: Recording, agent: Agent, name: string, step: number): Numbers | null {
  const table = recording.table("extras");
  const [names, steps] = [table.texts("name"), table.numbers("step")];
  const rows = recording.index("extras", "agent").upTo(agent.row, step);
  for (let i = rows.length - 1; i >= 0 && steps[rows[i]] === step; i--)
    if (names[rows[i]] === name) return table.list("values", rows[i]);
  return null;
}

/** Returns the numbers that the algorithm recorded over time, rewards first; lists of several give one series each. */
export function extraSeries(recording: Recording, agent: Agent): Series[] {
  const table = recording.table("extras");
  const [names, steps] = [table.texts("name"), table.numbers("step")];
  const series = new Map<string, Series>();
  for (const row of recording.index("extras", "agent").of(agent.row)) {
    if (steps[row] < agent.entryStep || (agent.endStep >= 0 && steps[row] > agent.endStep)) continue;
    if (names[row] === undefined || DISTRIBUTION.includes(names[row])) continue;
    const values = table.list("values", row);
    values.forEach((value, i) => {
      const name = values.length > 1 ? `${names[row]} ${i + 1}` : names[row];
      let each = series.get(name);
      if (!each) series.set(name, (each = { name, steps: [], values: [] }));
      each.steps.push(steps[row]);
      each.values.push(value);
    });
  }
  const rank = (name: string) => (name === "reward" ? 0 : name.startsWith("reward") ? 1 : 2);
  return [...series.values()].sort((a, b) => rank(a.name) - rank(b.name) || a.name.localeCompare(b.name));
}

/** Returns the speed of the agent's vehicle over time [m/s]; vehicles that it has had in turn are joined. */
export function speedSeries(recording: Recording, agent: Agent): Series {
  const series: Series = { name: "speed", steps: [], values: [] };
  const table = recording.table("agent_states");
  const steps = table.numbers("step");
  for (const row of recording.index("agent_states", "agent").of(agent.row)) {
    if (steps[row] < agent.entryStep || (agent.endStep >= 0 && steps[row] > agent.endStep)) continue;
    const speed = recording.speedOf(row);
    if (Number.isNaN(speed)) continue;
    series.steps.push(steps[row]);
    series.values.push(speed);
  }
  return series;
}

/** Returns what happened, in order of time: events of agents, ends, hand-overs, failures. */
export function markersOf(recording: Recording, agents: readonly Agent[]): Marker[] {
  const markers = [
    ...ends(agents),
    ...events(recording, agents),
    ...transfers(recording),
    ...failures(recording, agents),
  ];
  return markers.sort((a, b) => a.step - b.step);
}

function ends(agents: readonly Agent[]): Marker[] {
  const ended = agents.filter((agent) => agent.endStep >= 0 && agent.outcome !== "NONE");
  return ended.map((agent) => {
    const partner = agent.partner ? ` with ${agent.partner}` : "";
    return {
      step: agent.endStep,
      text: `${agent.name}: ${agent.outcomeText}${partner}`,
      tone: agent.tone,
      agent: agent.row,
    };
  });
}

function events(recording: Recording, agents: readonly Agent[]): Marker[] {
  const bits = Object.entries(recording.names.Event ?? {}).filter(([, name]) => Object.hasOwn(EVENT_WORDS, name));
  const table = recording.table("agent_states");
  const [steps, happened] = [table.numbers("step"), table.numbers("events")];
  const markers: Marker[] = [];
  for (const agent of agents) {
    let before = 0;
    for (const row of recording.index("agent_states", "agent").of(agent.row)) {
      if (steps[row] < agent.entryStep || (agent.endStep >= 0 && steps[row] >= agent.endStep)) continue;
      const begun = happened[row] & ~before;
      before = happened[row];
      for (const [bit, name] of begun ? bits : [])
        if (begun & Number(bit))
          markers.push({
            step: steps[row],
            text: `${agent.name}: ${EVENT_WORDS[name]}`,
            tone: eventTone(name),
            agent: agent.row,
          });
    }
  }
  return markers;
}

function eventTone(name: string): Tone {
  if (name === "COLLISION" || name === "OFF_ROAD") return "bad";
  return name === "VIA_HIT" || name === "LAP_COMPLETED" || name === "REACHED_GOAL" ? "good" : "warn";
}

function transfers(recording: Recording): Marker[] {
  const table = recording.table("transfers");
  const [steps, reasons, to, from] = ["step", "reason", "to_agent", "from_agent"].map((name) =>
    table.numbers(name),
  );
  const names = table.texts("name");
  const words: Record<string, string> = { TAKE: "an agent takes over", RELEASE: "an agent gives back" };
  const markers: Marker[] = [];
  for (let row = 0; row < table.rows; row++) {
    const text = known(words, named(recording, "Reason", reasons[row]));
    const agent = to[row] >= 0 ? to[row] : (from[row] ?? -1);
    if (text) markers.push({ step: steps[row], text: `${text} ${names[row] ?? ""}`, tone: "bubble", agent });
  }
  return markers;
}

function failures(recording: Recording, agents: readonly Agent[]): Marker[] {
  const table = recording.table("agent_failures");
  const [steps, rows] = [table.numbers("step"), table.numbers("agent")];
  return table.texts("text").map((text, row) => ({
    step: steps[row],
    text: `${agents[rows[row]]?.name ?? "an agent"} failed: ${text}`,
    tone: "bad" as const,
    agent: rows[row] ?? -1,
  }));
}
