/** Short messages over the page. */

import { h } from "./dom";

const LONG = 9000;

export class Toast {
  readonly element = h("div", { class: "toast", role: "alert", hidden: true });
  private timer: ReturnType<typeof setTimeout> | undefined;

  /** Shows a text for some time [ms]; the next one replaces it. */
  say(text: string, duration = LONG): void {
    this.element.textContent = text;
    this.element.hidden = false;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => (this.element.hidden = true), duration);
  }
}
