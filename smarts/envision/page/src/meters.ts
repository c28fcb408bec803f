/** The last action of an agent, with its distribution where it was recorded, and the pedals. */

import type { AgentState, Decision } from "./agents";
import { h } from "./dom";

/** Of the bar of the steering angle [degree]. */
const WIDEST = 35;

interface Line {
  name: string;
  /** Of the bar, 0 to 1. */
  part: number;
  text: string;
  isChosen: boolean;
  isLegal: boolean;
}

interface Row {
  element: HTMLElement;
  name: HTMLElement;
  bar: HTMLElement;
  value: HTMLElement;
}

export class ActionMeters {
  readonly element = h("section", { class: "action", "aria-label": "action" });
  private readonly head = h("h3", {}, "action");
  private readonly rows: Row[] = [];

  show(decision: Decision | null, state: AgentState | null): void {
    const lines = [...(decision ? linesOf(decision) : []), ...(state ? pedals(state) : [])];
    this.element.hidden = !lines.length;
    while (this.rows.length < lines.length) this.rows.push(row());
    if (this.element.children.length !== lines.length + 1)
      this.element.replaceChildren(this.head, ...this.rows.slice(0, lines.length).map(({ element }) => element));
    const isDistribution = decision !== null && (decision.probabilities ?? decision.means) !== null;
    this.head.textContent = isDistribution ? "action, with its distribution" : "action";
    lines.forEach((line, i) => {
      const { element, name, bar, value } = this.rows[i];
      name.textContent = line.name;
      bar.style.width = `${Math.min(100, Math.max(0, 100 * (line.part || 0)))}%`;
      value.textContent = line.text;
      element.toggleAttribute("data-chosen", line.isChosen);
      element.toggleAttribute("data-barred", !line.isLegal);
    });
  }
}

function linesOf(decision: Decision): Line[] {
  if (decision.choice >= 0)
    return decision.labels.map((name, i) => {
      const isChosen = i === decision.choice;
      const p = decision.probabilities?.[i];
      const text = p === undefined ? "" : `${(100 * p).toFixed(0)}%`;
      return { name, part: p ?? (isChosen ? 1 : 0), text, isChosen, isLegal: decision.isLegal[i] };
    });
  return decision.parts.flatMap(({ name, value, low, high }, i) => {
    const largest = Math.max(Math.abs(low), Math.abs(high));
    const line = { name, part: Math.abs(value) / largest, text: value.toFixed(2), isChosen: true, isLegal: true };
    const [mean, deviation] = [decision.means?.[i], decision.deviations?.[i]];
    if (mean === undefined) return [line];
    const text = deviation === undefined ? mean.toFixed(2) : `${mean.toFixed(2)} ±${deviation.toFixed(2)}`;
    return [line, { ...line, name: "its mean", part: Math.abs(mean) / largest, text, isChosen: false }];
  });
}

function pedals({ throttle, brake, steering }: AgentState): Line[] {
  const angle = (steering * 180) / Math.PI;
  return [
    { name: "throttle", part: throttle, text: throttle.toFixed(2), isChosen: false, isLegal: true },
    { name: "brake", part: brake, text: brake.toFixed(2), isChosen: false, isLegal: true },
    {
      name: "steering",
      part: Math.abs(angle) / WIDEST,
      text: `${angle.toFixed(1)}°`,
      isChosen: false,
      isLegal: true,
    },
  ];
}

function row(): Row {
  const [name, bar, value] = [h("span", { class: "name" }), h("i", {}), h("span", { class: "number" })];
  const element = h("div", { class: "meter" }, name, h("div", { class: "bar" }, bar), value);
  return { element, name, bar, value };
}
