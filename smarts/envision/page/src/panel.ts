/** What is known of the chosen agent: speed, action with its distribution, rewards, outcome. */

import {
  type Agent,
  type AgentState,
  decisionOf,
  extraSeries,
  type Series,
  speedSeries,
  stateOf,
} from "./agents";
import { Chart } from "./charts";
import { h } from "./dom";
import { ActionMeters } from "./meters";
import { observedBy } from "./observed";
import { SightPanel } from "./sightpanel";
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
  private readonly action = new ActionMeters();
  private readonly sight = new SightPanel();
  private readonly charts = h("section", { class: "charts" });
  private readonly empty = h("p", { class: "empty" }, "No agent in this recording.");
  private readonly body: HTMLElement;
  private view: View | null = null;
  private shown: { agent: Agent | null; version: number } = { agent: null, version: -1 };
  private chipsOf = "";
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
      this.action.element,
      this.charts,
      this.sight.element,
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
    this.chipsOf = "";
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
    this.shown = { agent, version: view.revision };
    this.last = NaN;
    this.showChips(view, agent);
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
    this.charts.replaceChildren(...this.drawn.map((chart) => chart.element));
  }

  /** Draws the agents' names where they have changed, and the chosen one's place. */
  private showChips(view: View, chosen: Agent | null): void {
    const shown = view.agents.slice(0, MOST_CHIPS);
    const key = shown.map((each) => `${each.row} ${each.name} ${each.outcome}`).join("\n");
    if (key !== this.chipsOf) {
      this.chipsOf = key;
      const rest = view.agents.length - shown.length;
      const more = rest > 0 ? [h("span", { class: "more" }, `and ${rest} more: click on their vehicles`)] : [];
      this.chips.replaceChildren(...shown.map((each) => this.chip(each, false)), ...more);
    }
    shown.forEach((each, i) => {
      const chip = this.chips.children[i];
      const isChosen = each.row === chosen?.row;
      const isNew = isChosen && chip.getAttribute("aria-selected") !== "true";
      chip.setAttribute("aria-selected", String(isChosen));
      if (isNew) chip.scrollIntoView({ block: "nearest", inline: "nearest" });
    });
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
        onClick: () => this.choose(agent.row),
      },
      h("i", { class: "dot" }),
      agent.name,
    );
  }

  private choose(row: number): void {
    // Agents are read anew when something has arrived.
    const agent = this.view?.agents.find((each) => each.row === row);
    if (agent) this.onChoose(agent);
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
    const speed = state?.speed ?? NaN;
    this.speed.textContent = Number.isFinite(speed) ? speed.toFixed(1) : "–";
    this.slow.textContent = Number.isFinite(speed) ? `m/s · ${(3.6 * speed).toFixed(0)} km/h` : "m/s";
    this.fillProgress(state);
    this.action.show(decisionOf(recording, agent, step), state);
    this.sight.show(observedBy(recording, agent, step));
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
}
