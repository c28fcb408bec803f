/** Where recordings come from: the page itself, or the server it came from. */

import { agentsOf, startsOf } from "./agents";
import { readContainer } from "./container";
import { Recording } from "./episode";
import { FormatError } from "./msgpack";

export interface Entry {
  id: string;
  label: string;
  run: string;
  scenario: string;
  traffic: string;
  episode: number;
  seed: number;
  /** Which simulation of its run it is of. */
  world: number;
  seconds: number;
  agents: number;
  outcomes: Record<string, number>;
  isComplete: boolean;
  /** Episodes with the same one are the same test episode. */
  pair: string;
  policy: string;
  /** Why it is shown, as "best"; empty where it was not chosen among others. */
  why: string;
  /** Why it cannot be opened; empty if it can. */
  error: string;
  /** Whether only its place is known yet. */
  isUnread: boolean;
  isLive: boolean;
  /** Of a live one: whether its simulation still runs. */
  isRunning: boolean;
}

export interface Library {
  entries: Entry[];
  load(id: string): Promise<Recording>;
  hasLive: boolean;
  /** Whether its recordings belong side by side. */
  isTogether: boolean;
  /** Whether the list comes from a server, and may grow. */
  isServed: boolean;
}

const text = (value: unknown): string =>
  typeof value === "string" ? value : value === undefined || value === null ? "" : String(value);
const number = (value: unknown): number => (Number.isFinite(Number(value)) ? Number(value) : 0);

function entryOf(id: string, raw: Record<string, unknown>): Entry {
  const outcomes = typeof raw.outcomes === "object" && raw.outcomes !== null ? raw.outcomes : {};
  return {
    id,
    label: text(raw.label) || `episode ${id}`,
    run: text(raw.run),
    scenario: text(raw.scenario),
    traffic: text(raw.traffic),
    episode: number(raw.episode),
    seed: number(raw.seed),
    world: number(raw.world),
    seconds: number(raw.seconds),
    agents: number(raw.agents),
    outcomes: Object.fromEntries(Object.entries(outcomes).map(([name, count]) => [name, number(count)])),
    isComplete: raw.complete !== false,
    pair: text(raw.pair),
    policy: text(raw.policy),
    why: text(raw.why),
    error: text(raw.error),
    isUnread: raw.unread === true,
    isLive: false,
    isRunning: false,
  };
}

/** Describes a recording that came without a list. */
export function describe(id: string, recording: Recording, label: string, why = ""): Entry {
  const { facts } = recording;
  const outcomes: Record<string, number> = {};
  const egos = agentsOf(recording).filter((agent) => agent.isEgo);
  for (const { outcome } of egos)
    outcomes[outcome.toLowerCase()] = (outcomes[outcome.toLowerCase()] ?? 0) + 1;
  const seconds = (recording.lastStep - recording.firstStep) * recording.dt;
  return {
    ...entryOf(id, { ...facts, label, why, seconds, agents: egos.length, complete: facts.is_complete }),
    outcomes,
    pair: pairOf(recording),
  };
}

/** The same for the same test episode, whatever drove. */
function pairOf(recording: Recording): string {
  const { scenario, traffic, traffic_seed: seed } = recording.facts;
  const starts = startsOf(recording);
  return scenario && starts.length ? JSON.stringify([scenario, traffic, seed, starts]) : "";
}

/** A library without episodes. */
export const NOTHING: Library = {
  entries: [],
  hasLive: false,
  isTogether: false,
  isServed: false,
  load: () => Promise.reject(new Error("nothing is open")),
};

/** Reads a recording; the bytes stay, since states are decoded from them again. */
async function open(bytes: Uint8Array): Promise<Recording> {
  const recording = new Recording();
  const damage = await readContainer(bytes, (message, packed) => recording.add(message, packed));
  if (damage || !recording.hasEnded) recording.remark ||= damage || "the recording is cut off";
  return recording;
}

/** Decodes base64; where it is cut, up to the cut. */
function decodeBase64(base64: string): Uint8Array {
  const text = base64.replace(/\s/g, "");
  let binary: string;
  try {
    binary = atob(text.length % 4 ? text.slice(0, -(text.length % 4)) : text);
  } catch {
    throw new FormatError("the recording inside the page is no base64");
  }
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

/** Recordings inside the page: `<script type="application/octet-stream" data-label=...>` with base64. */
async function embedded(): Promise<Library | null> {
  const scripts = [
    ...document.querySelectorAll<HTMLScriptElement>('script[type="application/octet-stream"]'),
  ];
  if (!scripts.length) return null;
  const parts: Part[] = [];
  for (const [i, script] of scripts.entries()) {
    const { textContent, dataset } = script;
    const read = async () => decodeBase64(textContent ?? "");
    parts.push({ id: dataset.id ?? String(i), label: dataset.label ?? "", why: dataset.why, read });
    script.remove();
  }
  return together(parts);
}

interface Part {
  id: string;
  label: string;
  why?: string;
  read(): Promise<Uint8Array>;
}

/** Opens recordings that come together; those that are damaged are listed with their errors. */
async function together(parts: readonly Part[]): Promise<Library> {
  const recordings = new Map<string, Recording>();
  const entries: Entry[] = [];
  for (const { id, label, why, read } of parts)
    try {
      const recording = await open(await read());
      recordings.set(id, recording);
      entries.push(describe(id, recording, label, why));
    } catch (error) {
      entries.push(entryOf(id, { label, why, error: error instanceof Error ? error.message : String(error) }));
    }
  return fromMap(entries, recordings);
}

function fromMap(entries: Entry[], recordings: Map<string, Recording>): Library {
  return {
    entries,
    hasLive: false,
    isTogether: true,
    isServed: false,
    load: async (id) => {
      const found = recordings.get(id);
      if (!found) throw new Error(`there is no episode ${id}`);
      return found;
    },
  };
}

async function fetchOk(path: string, init?: RequestInit): Promise<Response> {
  const response = await fetch(path, { credentials: "same-origin", cache: "no-store", ...init });
  if (response.ok) return response;
  const answer = (await response.text()).slice(0, 500);
  let reason = answer;
  try {
    const parsed: unknown = JSON.parse(answer);
    if (typeof parsed === "object" && parsed !== null)
      reason = text((parsed as Record<string, unknown>).error) || answer;
  } catch {
    // The answer is plain text.
  }
  throw new Error(reason || `the server answered ${response.status}`);
}

async function served(): Promise<Library> {
  const info = (await (await fetchOk("/api/info")).json()) as Record<string, unknown>;
  return {
    entries: await listEpisodes(),
    hasLive: info.live === true,
    isTogether: false,
    isServed: true,
    load: async (id) =>
      open(new Uint8Array(await (await fetchOk(`/api/episodes/${encodeURIComponent(id)}`)).arrayBuffer())),
  };
}

export async function listEpisodes(): Promise<Entry[]> {
  const list = (await (await fetchOk("/api/episodes")).json()) as Record<string, unknown>[];
  return list.map((each) => entryOf(text(each.id), each));
}

export async function findLibrary(): Promise<Library> {
  const inside = await embedded();
  if (inside) return inside;
  if (location.protocol.startsWith("http")) return served();
  return fromMap([], new Map());
}
