/** What is known of the chosen agent: speed, action with its distribution, rewards, outcome. */

import {
  type Agent,
  type AgentState,
  type Decision,
  decisionOf,
  extraSeries,
  type Series,
  speedSeries,
  stateOf,
} from "./agents";
import { Chart } from "./charts";
import { h } from "./dom";
import type { View } from "./view";

const MOST_CHIPS = 60;

export class Panel {
  readonly element: HTMLElement;
  private readonly chips = h("div", { class: "chips", role: "listbox", "aria-label": "agents" });
  private readonly name = h("h2", {});
  private readonly badge = h("span", { class: "badge" });
  private readonly status = h("span", { class: "status" });
  private readonly speed = h("span", { class: "big" });
  private readonly slow = h("span", { class: "unit" });
  private readonly progress = h("div", { class: "bar" }, h("i", {}));
  private readonly progressText = h("span", { class: "small" });
  private readonly action = h("section", { class: "action", "aria-label": "action" });
  private readonly rows: { element: HTMLElement; bar: HTMLElement; value: HTMLElement }[] = [];
  private readonly actionHead = h("h3", {}, "action");
  private readonly charts = h("section", { class: "charts" });
  private readonly empty = h("p", { class: "empty" }, "No agent in this recording.");
  private readonly body: HTMLElement;
  private view: View | null = null;
  private shown: { agent: Agent | null; version: number } = { agent: null, version: -1 };
  private drawn: Chart[] = [];
  private speeds: Series = { name: "speed", steps: [], values: [] };
  private last = NaN;

  constructor(
    private readonly onChoose: (agent: Agent) => void,
    private readonly onSeek: (step: number) => void,
  ) {
    const headline = h(
      "div",
      { class: "headline" },
      h("div", { class: "speed-now" }, this.speed, this.slow),
      h("div", { class: "route" }, this.progressText, this.progress),
    );
    this.body = h(
      "div",
      { class: "panel-body" },
      h("div", { class: "title" }, this.name, this.badge),
      this.status,
      headline,
      this.action,
      this.charts,
    );
    this.element = h(
      "aside",
      { class: "panel", id: "panel", "aria-label": "agent" },
      this.chips,
      this.empty,
      this.body,
    );
  }

  show(view: View | null): void {
    this.view = view;
    this.shown = { agent: null, version: -1 };
    this.last = NaN;
    this.update();
  }

  /** Shows the state at the view's time. */
  update(): void {
    const { view } = this;
    const agent = view?.chosen ?? null;
    this.empty.hidden = agent !== null;
    this.body.hidden = agent === null;
    if (!view) return;
    if (agent !== this.shown.agent || view.revision !== this.shown.version) this.rebuild(view, agent);
    const step = Math.floor(view.step + 1e-6);
    if (step === this.last) return;
    this.last = step;
    this.markPresent(view, step);
    if (agent) this.fill(view, agent, step);
  }

  private rebuild(view: View, agent: Agent | null): void {
    const isOther = agent !== this.shown.agent;
    this.shown = { agent, version: view.revision };
    this.last = NaN;
    this.chips.replaceChildren(
      ...view.agents.slice(0, MOST_CHIPS).map((each) => this.chip(each, each === agent)),
    );
    if (isOther)
      this.chips
        .querySelector<HTMLElement>("[aria-selected=true]")
        ?.scrollIntoView({ block: "nearest", inline: "nearest" });
    if (!agent) return;
    this.name.textContent = agent.name;
    const { recording } = view;
    const begin = Math.max(recording.firstStep, agent.entryStep);
    const end = agent.endStep >= 0 ? agent.endStep : recording.lastStep;
    this.speeds = speedSeries(recording, agent);
    const extras = extraSeries(recording, agent);
    const rewards = extras.filter((series) => series.name.startsWith("reward"));
    const groups: [string, string, Series[]][] = [["speed", "m/s", [this.speeds]]];
    if (rewards.length) groups.push(["reward", "", rewards]);
    for (const series of extras.filter((each) => !rewards.includes(each)).slice(0, 4))
      groups.push([series.name, "", [series]]);
    this.drawn = groups.map(([title, unit, series]) => {
      const chart = new Chart(title, unit, title === "reward" ? 64 : 46, this.onSeek);
      chart.show(series, begin, end);
      return chart;
    });
    const legend =
      rewards.length > 1
        ? [
            h(
              "div",
              { class: "keys" },
              ...rewards
                .slice(0, 6)
                .map((each, i) => h("span", { class: `key key-${i}` }, each.name.replace(/^reward\//, ""))),
            ),
          ]
        : [];
    this.charts.replaceChildren(
      ...this.drawn.slice(0, 2).map((chart) => chart.element),
      ...legend,
      ...this.drawn.slice(2).map((chart) => chart.element),
    );
  }

  private chip(agent: Agent, isChosen: boolean): HTMLElement {
    return h(
      "button",
      {
        class: "chip",
        type: "button",
        role: "option",
        "aria-selected": String(isChosen),
        "data-kind": agent.isEgo ? "ego" : "social",
        "data-tone": agent.tone,
        title: `${agent.name}: ${agent.outcomeText}`,
        onClick: () => this.onChoose(agent),
      },
      h("i", { class: "dot" }),
      agent.name,
    );
  }

  private markPresent(view: View, step: number): void {
    view.agents.slice(0, MOST_CHIPS).forEach((agent, i) => {
      const isThere =
        agent.entryStep >= 0 && step >= agent.entryStep && (agent.endStep < 0 || step <= agent.endStep);
      this.chips.children[i]?.toggleAttribute("data-absent", !isThere);
    });
  }

  private fill(view: View, agent: Agent, step: number): void {
    const { recording } = view;
    const isOver = agent.endStep >= 0 && step >= agent.endStep;
    const hasEntered = agent.entryStep >= 0 && step >= agent.entryStep;
    this.badge.textContent = isOver ? agent.outcomeText : hasEntered ? "driving" : "not yet there";
    this.badge.dataset.tone = isOver ? agent.tone : "plain";
    const state = hasEntered ? stateOf(recording, agent, step) : null;
    const change = state?.change && state.change !== "none" ? `, lane change ${state.change}` : "";
    const with_ = isOver && agent.partner ? `with ${agent.partner}` : "";
    this.status.textContent =
      with_ || (state ? `${state.status}${change}` : agent.isEgo ? "ego" : "social agent");
    const speed = state ? recording.speedAt(state.vehicle, step) : NaN;
    this.speed.textContent = Number.isFinite(speed) ? speed.toFixed(1) : "–";
    this.slow.textContent = Number.isFinite(speed) ? `m/s · ${(3.6 * speed).toFixed(0)} km/h` : "m/s";
    this.fillProgress(state);
    this.fillAction(decisionOf(recording, agent, step), state);
    for (const chart of this.drawn) chart.update(step);
  }

  private fillProgress(state: AgentState | null): void {
    const [done, left] = [state?.progress ?? NaN, state?.remaining ?? NaN];
    const isKnown = Number.isFinite(done) && Number.isFinite(left) && done + left > 0;
    this.progress.hidden = !isKnown;
    (this.progress.firstElementChild as HTMLElement).style.width = isKnown
      ? `${Math.min(100, (100 * done) / (done + left))}%`
      : "0";
    this.progressText.textContent = isKnown ? `${Math.max(0, left).toFixed(0)} m to the goal` : "";
  }

  private fillAction(decision: Decision | null, state: AgentState | null): void {
    const lines: { name: string; part: number; text: string; isChosen: boolean; isLegal: boolean }[] = [];
    if (decision && decision.choice >= 0) {
      decision.labels.forEach((name, i) => {
        const isChosen = i === decision.choice;
        const p = decision.probabilities?.[i];
        lines.push({
          name,
          part: p ?? (isChosen ? 1 : 0),
          text: p === undefined ? "" : `${(100 * p).toFixed(0)}%`,
          isChosen,
          isLegal: decision.isLegal[i],
        });
      });
    } else if (decision) {
      for (const { name, value, low, high } of decision.parts)
        lines.push({
          name,
          part: Math.abs(value) / Math.max(Math.abs(low), Math.abs(high)),
          text: value.toFixed(2),
          isChosen: true,
          isLegal: true,
        });
    }
    if (state) {
      lines.push({
        name: "throttle",
        part: state.throttle,
        text: state.throttle.toFixed(2),
        isChosen: false,
        isLegal: true,
      });
      lines.push({
        name: "brake",
        part: state.brake,
        text: state.brake.toFixed(2),
        isChosen: false,
        isLegal: true,
      });
      const angle = (state.steering * 180) / Math.PI;
      lines.push({
        name: "steering",
        part: Math.abs(angle) / 35,
        text: `${angle.toFixed(1)}°`,
        isChosen: false,
        isLegal: true,
      });
    }
    this.action.hidden = !lines.length;
    while (this.rows.length < lines.length) this.rows.push(row());
    if (this.action.children.length !== lines.length + 1)
      this.action.replaceChildren(
        this.actionHead,
        ...this.rows.slice(0, lines.length).map((each) => each.element),
      );
    const isDistribution = decision?.probabilities != null;
    this.actionHead.textContent = isDistribution ? "action, with its distribution" : "action";
    lines.forEach((line, i) => {
      const { element, bar, value } = this.rows[i];
      element.firstElementChild!.textContent = line.name;
      bar.style.width = `${Math.min(100, Math.max(0, 100 * (line.part || 0)))}%`;
      value.textContent = line.text;
      element.toggleAttribute("data-chosen", line.isChosen);
      element.toggleAttribute("data-barred", !line.isLegal);
    });
  }
}

function row(): { element: HTMLElement; bar: HTMLElement; value: HTMLElement } {
  const bar = h("i", {});
  const value = h("span", { class: "number" });
  return {
    element: h(
      "div",
      { class: "meter" },
      h("span", { class: "name" }),
      h("div", { class: "bar" }, bar),
      value,
    ),
    bar,
    value,
  };
}
