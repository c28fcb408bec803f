/** What colours mean. */

import { h } from "./dom";
import type { Recording } from "./episode";
import { DARK, type Rgb, type Theme } from "./scene/palette";
import { Driver } from "./snapshot";

const ENTRIES: [Driver, string][] = [
  [Driver.Ego, "ego"],
  [Driver.Social, "social agent"],
  [Driver.Traffic, "traffic"],
  [Driver.Fallback, "fallback"],
  [Driver.Other, "other provider"],
];

const css = (colour: Rgb): string => `rgb(${colour.map((part) => Math.round(255 * part)).join(" ")})`;

export class Legend {
  readonly element = h("div", { class: "legend", "aria-label": "legend" });
  private theme: Theme = DARK;
  private recording: Recording | null = null;

  show(recording: Recording | null): void {
    this.recording = recording;
    this.draw();
  }

  paint(theme: Theme): void {
    this.theme = theme;
    this.draw();
  }

  private draw(): void {
    const { recording, theme } = this;
    const interfaces = recording ? Array.from(recording.table("agents").numbers("interface")) : [];
    const hasBubbles = (recording?.table("bubbles").rows ?? 0) > 0;
    const hasSocial = interfaces.some((number) => number >= 0);
    const isShown: Record<Driver, boolean> = {
      [Driver.Ego]: interfaces.some((number) => number < 0),
      [Driver.Social]: hasSocial,
      [Driver.Traffic]: true,
      [Driver.Fallback]: hasSocial || hasBubbles,
      [Driver.Other]: false,
    };
    const items = ENTRIES.filter(([driver]) => isShown[driver]).map(([driver, name]) =>
      item(name, css(theme.drivers[driver])),
    );
    if (hasBubbles || hasSocial) {
      const [a, b] = [css(theme.drivers[Driver.Traffic]), css(theme.drivers[Driver.Social])];
      items.push(item("air-lock", `repeating-linear-gradient(115deg, ${a} 0 3px, ${b} 3px 6px)`));
    }
    if (hasBubbles) items.push(item("bubble", css(theme.bubble), "ring"));
    if (recording?.table("observations").rows) items.push(item("observed", css(theme.sight), "ring"));
    this.element.replaceChildren(...items);
    this.element.hidden = !recording;
  }
}

function item(name: string, background: string, shape = "body"): HTMLElement {
  const swatch = h("i", { "data-shape": shape });
  if (shape === "ring") swatch.style.borderColor = background;
  else swatch.style.background = background;
  return h("span", {}, swatch, name);
}
