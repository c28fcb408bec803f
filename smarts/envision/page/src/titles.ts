/** What views and problems are called. */

import { describe, type Entry } from "./library";
import { Driver } from "./snapshot";
import type { View } from "./view";

const DRIVEN_BY: Record<Driver, string> = {
  [Driver.Ego]: "driven by an ego",
  [Driver.Social]: "driven by a social agent",
  [Driver.Traffic]: "driven by traffic",
  [Driver.Fallback]: "driven by the fallback controller",
  [Driver.Other]: "driven by another provider",
};

export const reason = (error: unknown): string => (error instanceof Error ? error.message : String(error));

export function titleOf(entry: Entry | undefined, id: string): string {
  if (!entry) return id;
  if (entry.isLive) return entry.label;
  return [entry.why, entry.scenario || entry.label, entry.policy || entry.run].filter(Boolean).join(" · ");
}

/** What may tell episodes of the same title apart, in the order in which it is added. */
const DETAILS: ((entry: Entry) => string)[] = [
  // Folders of a run's tests are called MODE-SCENARIO, those of runs seed_NUMBER.
  ({ run }) => /(?:^|\/)([^/-]+)-[^/]*$/.exec(run)?.[1] ?? "",
  ({ run }) => (/(?:^|\/)seed_\d+(?=\/|$)/.exec(run)?.[0] ?? "").replace(/^\/?seed_/, "trained with seed "),
  ({ traffic }) => traffic && `traffic ${traffic}`,
  ({ seed }) => `seed ${seed}`,
  ({ world }) => `world ${world}`,
  ({ episode }) => `episode ${episode}`,
  ({ label }) => label,
  ({ run }) => run,
];

/** The titles of entries: where several would be the same, with what they differ in. */
export function titlesOf(entries: readonly Entry[]): string[] {
  const bases = entries.map((entry) => titleOf(entry, entry.id));
  let titles = bases;
  for (const detail of DETAILS) {
    const more = entries.map(detail);
    const hasMore = (i: number): boolean => titles.some((title, j) => title === titles[i] && more[j] !== more[i]);
    // All episodes of one title say what only some of them need.
    const isAdded = new Set(bases.filter((_, i) => hasMore(i)));
    titles = titles.map((title, i) => (isAdded.has(bases[i]) && more[i] ? `${title} · ${more[i]}` : title));
  }
  return titles;
}

/** Why a simulation that was watched has ended before its episode did; empty where it has not. */
export function cutShort({ isLive, hasEnded, isComplete, remark }: View["recording"]): string {
  return isLive && hasEnded && !isComplete ? remark || "it has ended" : "";
}

export function subtitle(view: View): string {
  const { facts } = view.recording;
  const parts = [
    cutShort(view.recording),
    facts.traffic && `traffic ${String(facts.traffic)}`,
    facts.seed !== undefined && `seed ${String(facts.seed)}`,
    facts.episode !== undefined && `episode ${String(facts.episode)}`,
  ];
  return parts.filter(Boolean).join(" · ") || describe(view.id, view.recording, "").label;
}

/** What a cell says: how its agents have ended so far, or why their simulation has. */
export function statusOf(view: View): [string, string] {
  const remark = cutShort(view.recording);
  if (remark) return [remark, "bad"];
  const ended = view.agents.filter(
    (agent) => agent.isEgo && agent.endStep >= 0 && view.step >= agent.endStep && agent.outcome !== "NONE",
  );
  const worst =
    ended.find((agent) => agent.tone === "bad") ?? ended.find((agent) => agent.tone === "warn") ?? ended[0];
  return worst ? [worst.outcomeText, worst.tone] : ["", "plain"];
}

/** What is said of a vehicle without an agent: number `place` of those that are there now. */
export function vehicleText(view: View, place: number): string {
  const { number, speed, driver } = view.now;
  const name = view.recording.vehicles[number[place]]?.name || "a vehicle";
  return `${name}: ${speed[place].toFixed(1)} m/s, ${DRIVEN_BY[driver[place] as Driver]}`;
}
