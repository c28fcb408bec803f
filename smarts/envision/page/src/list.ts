/** The list of recordings and of simulations that run: sorted, filtered, chosen for the grid. */

import { outcomeText, outcomeTone } from "./agents";
import { h, iconButton } from "./dom";
import type { Entry } from "./library";

type Key = "scenario" | "outcome" | "seconds" | "agents";
const HEADS: [Key, string][] = [
  ["scenario", "episode"],
  ["outcome", "outcomes"],
  ["agents", "agents"],
  ["seconds", "time"],
];
const MOST = 9;
/** Rows that are drawn. */
const MOST_ROWS = 1000;
const SEVERITY: Record<string, number> = { bad: 1000, warn: 30, plain: 1, good: 0 };

/** How badly an episode ended: the part of its agents that failed, collisions before others. */
export function severity(entry: Entry): number {
  const counts = Object.entries(entry.outcomes);
  const all = counts.reduce((sum, [, count]) => sum + count, 0) || 1;
  const bad = counts.reduce(
    (sum, [name, count]) =>
      sum + count * (SEVERITY[outcomeTone(name.toUpperCase())] + (name === "collision" ? 500 : 0)),
    0,
  );
  return entry.error ? -1 : bad / all;
}

const liveText = (entry: Entry): string => (entry.isRunning ? "live" : "ended");

function compare(key: Key, a: Entry, b: Entry): number {
  if (key === "outcome") return severity(a) - severity(b);
  if (key === "scenario")
    return a.scenario.localeCompare(b.scenario) || a.run.localeCompare(b.run) || a.episode - b.episode;
  return a[key] - b[key];
}

export class List {
  readonly element: HTMLDialogElement;
  private entries: Entry[] = [];
  private open: readonly string[] = [];
  private hidden = 0;
  private key: Key = "scenario";
  private isDescending = false;
  private readonly body = h("div", { class: "rows", role: "rowgroup" });
  private readonly heads: HTMLElement;
  private readonly filter: HTMLInputElement;
  private readonly note = h("p", { class: "note", role: "status" });

  constructor(
    private readonly onOpen: (ids: string[], isCompared: boolean) => void,
  ) {
    this.filter = h("input", {
      type: "search",
      placeholder: "filter: scenario, run, outcome",
      "aria-label": "filter",
      onInput: () => this.draw(),
    });
    this.heads = h(
      "div",
      { class: "heads", role: "row" },
      ...HEADS.map(([key, name]) =>
        h(
          "button",
          { type: "button", role: "columnheader", "data-key": key, onClick: () => this.sort(key) },
          name,
        ),
      ),
    );
    this.element = h(
      "dialog",
      { class: "list", "aria-label": "episodes" },
      h(
        "header",
        {},
        h("h2", {}, "Episodes"),
        this.filter,
        iconButton("close", "Close", () => this.element.close(), "esc"),
      ),
      h("div", { class: "table", role: "table", "aria-label": "episodes" }, this.heads, this.body),
      this.note,
    );
    this.element.addEventListener("click", (event) => {
      if (event.target === this.element) this.element.close();
    });
  }

  /** Shows entries; `hidden` simulations run that are not among them. */
  show(entries: Entry[], open: readonly string[], hidden = 0): void {
    this.entries = entries;
    this.hidden = hidden;
    this.open = open;
    if (this.element.open) this.draw();
  }

  toggle(): void {
    if (this.element.open) this.element.close();
    else {
      this.element.showModal();
      this.draw();
    }
  }

  private sort(key: Key): void {
    this.isDescending = key === this.key ? !this.isDescending : key === "outcome";
    this.key = key;
    this.draw();
  }

  private draw(): void {
    const words = this.filter.value.toLowerCase().split(/\s+/).filter(Boolean);
    const shown = this.entries.filter((entry) => {
      const all = [
        entry.label,
        entry.scenario,
        entry.traffic,
        entry.run,
        entry.policy,
        entry.why,
        entry.isLive ? liveText(entry) : "",
        ...Object.keys(entry.outcomes),
      ]
        .join(" ")
        .toLowerCase();
      return words.every((word) => all.includes(word));
    });
    shown.sort(
      (a, b) => Number(b.isLive) - Number(a.isLive) || (this.isDescending ? -1 : 1) * compare(this.key, a, b),
    );
    for (const head of this.heads.children) {
      const isKey = (head as HTMLElement).dataset.key === this.key;
      head.setAttribute("aria-sort", isKey ? (this.isDescending ? "descending" : "ascending") : "none");
    }
    const pairs = new Map<string, Entry[]>();
    for (const entry of this.entries)
      if (entry.pair && !entry.error) pairs.set(entry.pair, [...(pairs.get(entry.pair) ?? []), entry]);
    const focus = this.focused();
    this.body.replaceChildren(...shown.slice(0, MOST_ROWS).map((entry) => this.row(entry, pairs.get(entry.pair) ?? [])));
    // The list of simulations that run is drawn again and again; the keyboard stays where it is.
    this.body.querySelector<HTMLElement>(focus)?.focus();
    const unread = this.entries.filter((entry) => entry.isUnread).length;
    const first = shown.length > MOST_ROWS ? `the first ${MOST_ROWS} of ` : "";
    const rest = unread ? `, ${unread} of them not read yet` : "";
    const text = this.entries.length
      ? `${first}${shown.length} of ${this.entries.length}${rest}; up to ${MOST} side by side with +`
      : "No episodes.";
    this.note.textContent = this.hidden ? `${text}. ${this.hidden} more simulations run and are not shown.` : text;
  }

  /** A selector for the button with the focus; "none" where it is elsewhere. */
  private focused(): string {
    const button = document.activeElement;
    const row = this.body.contains(button) ? button?.closest<HTMLElement>(".row") : null;
    return row ? `[data-id="${CSS.escape(row.dataset.id ?? "")}"] .${button?.classList[0] ?? "open"}` : "none";
  }

  private row(entry: Entry, pair: readonly Entry[]): HTMLElement {
    const isOpen = this.open.includes(entry.id);
    const partners = pair.filter((other) => other.id !== entry.id);
    const title = entry.scenario || entry.label;
    const under = [
      entry.run,
      entry.traffic && `traffic ${entry.traffic}`,
      entry.scenario ? entry.label : "",
    ]
      .filter(Boolean)
      .join(" · ");
    const outcomes = Object.entries(entry.outcomes)
      .filter(([name]) => name !== "none")
      .map(([name, count]) =>
        h(
          "span",
          { class: "badge", "data-tone": outcomeTone(name.toUpperCase()) },
          count > 1 ? `${count} ${outcomeText(name)}` : outcomeText(name),
        ),
      );
    const name = h(
      "button",
      { class: "open", type: "button", disabled: entry.error !== "", onClick: () => this.choose([entry.id]) },
      h("b", {}, title),
      entry.why ? h("span", { class: "badge why" }, entry.why) : null,
      entry.policy ? h("span", { class: "badge" }, entry.policy) : null,
      entry.isLive ? h("span", { class: "badge", "data-tone": entry.isRunning ? "live" : "warn" }, liveText(entry)) : null,
      h("small", {}, under),
    );
    const add = h(
      "button",
      {
        class: "add",
        type: "button",
        disabled: entry.error !== "" || (!isOpen && this.open.length >= MOST),
        "aria-pressed": String(isOpen),
        "aria-label": isOpen ? `Remove ${title} from the grid` : `Show ${title} beside the others`,
        onClick: () => this.toggleOne(entry.id),
      },
      isOpen ? "−" : "+",
    );
    const both = partners.length
      ? h(
          "button",
          {
            class: "compare text-button",
            type: "button",
            title: `The same test episode of ${partners.map((other) => other.policy || other.run || other.label).join(", ")}`,
            onClick: () => this.choose([entry.id, ...partners.map((other) => other.id)], true),
          },
          "compare",
        )
      : null;
    return h(
      "div",
      { class: "row", role: "row", "data-id": entry.id, "data-open": isOpen, "data-error": entry.error !== "" },
      h("div", { role: "cell", class: "first" }, name, both),
      h(
        "div",
        { role: "cell", class: "outcomes" },
        ...(entry.error ? [h("span", { class: "error" }, entry.error)] : outcomes),
      ),
      h("div", { role: "cell", class: "count" }, entry.agents ? String(entry.agents) : ""),
      h("div", { role: "cell", class: "count" }, entry.seconds ? `${entry.seconds.toFixed(0)} s` : ""),
      add,
    );
  }

  private choose(ids: string[], isCompared = false): void {
    this.onOpen(ids, isCompared);
    this.element.close();
  }

  private toggleOne(id: string): void {
    const next = this.open.includes(id) ? this.open.filter((each) => each !== id) : [...this.open, id];
    if (next.length) this.onOpen(next, false);
  }
}
