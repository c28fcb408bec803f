/** Short messages over the page. */

import { h } from "./dom";

const LONG = 9000;
const MOST_LINES = 4;

export class Toast {
  readonly element = h("div", { class: "toast", role: "alert", hidden: true });
  private timer: ReturnType<typeof setTimeout> | undefined;

  private isLong = false;

  /** Shows a text for some time [ms]; a short one is replaced by the next one, a long one stays above it. */
  say(text: string, duration = LONG): void {
    const lines = this.isLong && !this.element.hidden ? (this.element.textContent ?? "").split("\n") : [];
    this.element.textContent = [...lines.filter((line) => line !== text), text].slice(-MOST_LINES).join("\n");
    this.isLong = duration >= LONG;
    this.element.hidden = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => (this.element.hidden = true), duration);
  }
}
