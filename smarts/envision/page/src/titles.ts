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
