/** The bar below: play, step, speed, and a time line with what happened on it. */

import type { Marker, Tone } from "./agents";
import { h, iconButton, seconds, setIcon } from "./dom";
import { type Clock, SPEEDS } from "./playback";

const RANK: Record<Tone, number> = { bad: 4, good: 3, warn: 2, bubble: 1, plain: 0 };
const NARROW = 0.006;
const NEAR = 0.05;
const TICK = 50;

export interface Actions {
  toggle(): void;
  seek(t: number): void;
  step(steps: number): void;
  setSpeed(speed: number): void;
  goLive(): void;
}

export class Timeline {
  readonly element: HTMLElement;
  private readonly playButton: HTMLButtonElement;
  private readonly track: HTMLElement;
  private readonly fill = h("div", { class: "track-fill" });
  private readonly knob = h("div", { class: "track-knob" });
  private readonly marks = h("div", { class: "marks" });
  private readonly hint = h("div", { class: "track-hint", role: "status" });
  private readonly time = h("span", { class: "time" });
  private readonly speed: HTMLSelectElement;
  private readonly live: HTMLButtonElement;
  private clock: Clock | null = null;
  private markers: readonly Marker[] = [];
  private dt = 0.1;
  private drawn = "";
  private updated = -Infinity;

  constructor(
    private readonly actions: Actions,
    private readonly onMarker: (marker: Marker) => void,
  ) {
    this.playButton = iconButton("play", "Play", actions.toggle, "space");
    this.playButton.classList.add("play");
    this.track = h(
      "div",
      {
        class: "track",
        role: "slider",
        tabindex: 0,
        "aria-label": "time",
        "aria-valuemin": 0,
        onPointerdown: (event: PointerEvent) => this.grab(event),
        onPointermove: (event: PointerEvent) => this.hover(event),
        onPointerleave: () => this.say(""),
      },
      h("div", { class: "track-rail" }, this.fill),
      this.knob,
    );
    this.speed = h(
      "select",
      { class: "speed", "aria-label": "speed", onChange: () => actions.setSpeed(Number(this.speed.value)) },
      ...SPEEDS.map((speed) => h("option", { value: speed }, `${speed}×`)),
    );
    this.live = h("button", { class: "live", type: "button", hidden: true, onClick: actions.goLive }, "live");
    this.element = h(
      "footer",
      { class: "transport", "aria-label": "playback" },
      h(
        "div",
        { class: "buttons" },
        iconButton("back", "To the event before", () => this.jump(-1), "["),
        iconButton("before", "One step back", () => actions.step(-1), ","),
        this.playButton,
        iconButton("after", "One step", () => actions.step(1), "."),
        iconButton("forward", "To the next event", () => this.jump(1), "]"),
      ),
      h("div", { class: "timeline" }, this.hint, this.marks, this.track),
      h("div", { class: "readout" }, this.time, this.live, this.speed),
    );
  }

  /** Shows another clock and what happens on it. */
  show(clock: Clock, markers: readonly Marker[], dt: number): void {
    Object.assign(this, { clock, markers, dt });
    this.drawn = "";
    this.update();
  }

  private get span(): number {
    return this.clock ? Math.max(1e-6, this.clock.end - this.clock.begin) : 1;
  }

  private place(t: number): number {
    return this.clock ? Math.min(1, Math.max(0, (t - this.clock.begin) / this.span)) : 0;
  }

  /** Shows the time, at most 20 times a second while it runs: each change makes the browser paint. */
  tick(now: number): void {
    if (now - this.updated < TICK && this.clock?.isPlaying) return;
    this.updated = now;
    this.update();
  }

  private update(): void {
    const { clock } = this;
    if (!clock) return;
    const part = this.place(clock.t);
    this.fill.style.transform = `scaleX(${part})`;
    this.knob.style.left = `${100 * part}%`;
    const time = `${seconds(clock.t)} / ${seconds(clock.end)} s`;
    if (this.time.textContent !== time) {
      this.time.textContent = time;
      this.track.setAttribute("aria-valuemin", clock.begin.toFixed(1));
      this.track.setAttribute("aria-valuenow", clock.t.toFixed(1));
      this.track.setAttribute("aria-valuemax", clock.end.toFixed(1));
      this.track.setAttribute("aria-valuetext", `${seconds(clock.t)} seconds`);
    }
    setIcon(this.playButton, clock.isPlaying ? "pause" : "play", clock.isPlaying ? "Pause" : "Play");
    if (this.speed.value !== String(clock.speed)) this.speed.value = String(clock.speed);
    this.live.hidden = !clock.isLive;
    const isOn = clock.isPlaying && clock.isFollowing;
    this.live.toggleAttribute("data-on", isOn);
    const text = clock.hasEnded ? "ended" : "live";
    if (this.live.textContent !== text) this.live.textContent = text;
    this.live.toggleAttribute("data-ended", clock.hasEnded);
    this.live.setAttribute("aria-label", isOn ? text : "back to live");
    this.drawMarks();
  }

  private drawMarks(): void {
    const key = `${this.markers.length} ${this.span.toFixed(0)} ${this.clock?.begin.toFixed(0)}`;
    if (key === this.drawn) return;
    this.drawn = key;
    const groups: { part: number; all: Marker[] }[] = [];
    for (const marker of this.markers) {
      const part = this.place(marker.step * this.dt);
      const last = groups[groups.length - 1];
      if (last && part - last.part < NARROW) last.all.push(marker);
      else groups.push({ part, all: [marker] });
    }
    this.marks.replaceChildren(...groups.map(({ part, all }) => this.mark(part, all)));
  }

  private mark(part: number, all: readonly Marker[]): HTMLElement {
    const chief = all.reduce((best, each) => (RANK[each.tone] > RANK[best.tone] ? each : best));
    const at = seconds(chief.step * this.dt);
    const more = all.length > 1 ? ` and ${all.length - 1} more` : "";
    const label = `${at} s: ${chief.text}${more}`;
    const element = h("button", {
      class: "mark",
      type: "button",
      "data-tone": chief.tone,
      "aria-label": label,
      title: label,
      tabindex: RANK[chief.tone] > 1 ? 0 : -1,
      onClick: () => this.choose(chief),
      onPointerenter: () => this.say(label, part),
      onPointerleave: () => this.say(""),
    });
    element.style.left = `${100 * part}%`;
    return element;
  }

  private choose(marker: Marker): void {
    this.actions.seek(marker.step * this.dt);
    this.onMarker(marker);
  }

  /** Goes to the next event, or to the one before. */
  jump(sign: 1 | -1): void {
    if (!this.clock) return;
    const now = this.clock.t;
    const later = this.markers.filter((marker) => sign * (marker.step * this.dt - now) > NEAR);
    const next = sign > 0 ? later[0] : later[later.length - 1];
    if (next) {
      this.choose(next);
      this.say(`${seconds(next.step * this.dt)} s: ${next.text}`, this.place(next.step * this.dt));
      setTimeout(() => this.say(""), 2500);
    } else this.actions.seek(sign > 0 ? this.clock.end : this.clock.begin);
  }

  private say(text: string, part = 0): void {
    this.hint.textContent = text;
    this.hint.toggleAttribute("data-on", text !== "");
    if (text) this.hint.style.left = `clamp(0px, ${100 * part}%, 100%)`;
    this.hint.style.setProperty("--shift", `${-100 * part}%`);
  }

  private grab(event: PointerEvent): void {
    this.track.setPointerCapture(event.pointerId);
    this.seekTo(event);
  }

  private hover(event: PointerEvent): void {
    if (event.buttons & 1) this.seekTo(event);
  }

  private seekTo(event: PointerEvent): void {
    const box = this.track.getBoundingClientRect();
    if (this.clock)
      this.actions.seek(this.clock.begin + ((event.clientX - box.left) / box.width) * this.span);
  }
}
