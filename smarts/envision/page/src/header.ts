/** The bar above: what is shown, the camera, and the page's own settings. */

import { h, iconButton, svg } from "./dom";
import type { LiveState } from "./live";
import type { Mode } from "./scene/camera";

export interface HeaderActions {
  list(): void;
  mode(mode: Mode): void;
  fit(): void;
  theme(): void;
  link(): void;
  help(): void;
  inStep(): void;
  panel(): void;
}

const MODES: [Mode, string, string][] = [
  ["top", "Top", "1"],
  ["follow", "Follow", "2"],
  ["free", "Free", "3"],
];

export class Header {
  readonly element: HTMLElement;
  private readonly title = h("h1", {});
  private readonly subtitle = h("small", {});
  private readonly count = h("span", { class: "count" });
  private readonly live = h("span", { class: "live-state", role: "status", hidden: true });
  private readonly modes: HTMLButtonElement[];
  private readonly sync: HTMLButtonElement;

  constructor(actions: HeaderActions) {
    this.modes = MODES.map(([mode, name, key]) =>
      h(
        "button",
        {
          type: "button",
          "data-mode": mode,
          "aria-pressed": "false",
          title: `${name} camera (${key})`,
          onClick: () => actions.mode(mode),
        },
        name,
      ),
    );
    this.sync = h(
      "button",
      {
        type: "button",
        class: "text-button sync",
        hidden: true,
        "aria-pressed": "true",
        title: "Views in step, or each by itself (s)",
        onClick: actions.inStep,
      },
      "in step",
    );
    const list = iconButton("list", "Episodes", actions.list, "e");
    list.append(this.count);
    list.classList.add("list-button");
    this.element = h(
      "header",
      { class: "top" },
      list,
      h("div", { class: "headline-title" }, mark(), h("div", {}, this.title, this.subtitle)),
      this.live,
      h(
        "div",
        { class: "tools" },
        this.sync,
        h("div", { class: "segments", role: "group", "aria-label": "camera" }, ...this.modes),
        iconButton("fit", "Show where agents drive", actions.fit, "0"),
        iconButton("theme", "Dark or light", actions.theme, "t"),
        iconButton("link", "Copy the link to this view", actions.link, "l"),
        iconButton("help", "Keys", actions.help, "?"),
        iconButton("panel", "Panel of the agent", actions.panel, "p"),
      ),
    );
    this.setMode("top");
  }

  setTitle(title: string, subtitle: string): void {
    this.title.textContent = title;
    this.subtitle.textContent = subtitle;
    document.title = title === "Envision" ? title : `${title} · Envision`;
  }

  setMode(mode: Mode): void {
    for (const button of this.modes)
      button.setAttribute("aria-pressed", String(button.dataset.mode === mode));
  }

  setGrid(count: number, isInStep: boolean): void {
    this.sync.hidden = count < 2;
    this.sync.setAttribute("aria-pressed", String(isInStep));
    this.sync.textContent = isInStep ? "in step" : "each by itself";
  }

  setCount(count: number): void {
    this.count.textContent = count > 1 ? String(count) : "";
  }

  setLive(state: LiveState): void {
    this.live.hidden = false;
    this.live.dataset.state = state;
    this.live.textContent =
      state === "connected" ? "live" : state === "lost" ? "connection lost, trying again" : "connecting";
  }
}

/** The page's sign: a lane that parts. */
function mark(): SVGSVGElement {
  return svg(
    "svg",
    { viewBox: "0 0 24 24", class: "mark-sign", "aria-hidden": "true" },
    svg("path", {
      d: "M12 22V13M12 13C12 9 6 9 6 3M12 13C12 9 18 9 18 3",
      fill: "none",
      stroke: "currentColor",
      "stroke-width": "2.600",
      "stroke-linecap": "round",
    }),
  );
}
