/** The page: its parts, what is chosen, the camera and the keys. */

import type { Agent, Marker } from "./agents";
import { h } from "./dom";
import { Header } from "./header";
import { helpDialog } from "./help";
import { keyAction } from "./keys";
import { Legend } from "./legend";
import { formatLink, parseLink, type Place } from "./link";
import { List } from "./list";
import { Panel } from "./panel";
import type { Mode } from "./scene/camera";
import { DARK, LIGHT, type Theme } from "./scene/palette";
import { Session } from "./session";
import { keep, storedTheme } from "./settings";
import { Stage } from "./stage";
import { Timeline } from "./timeline";
import { Toast } from "./toast";
import { reason, statusOf, subtitle, vehicleText } from "./titles";
import type { View } from "./view";

const PANEL_RATE = 90;
const LINK_RATE = 700;
/** From one request for observations to the next, at least [ms]: the server takes 20 a second. */
const SIGHT_RATE = 300;

export class App {
  readonly element = h("div", { class: "app" });
  private readonly session = new Session({
    say: (text) => this.toast.say(text),
    fail: (text) => this.fail(text),
    arranged: (before, place) => this.arrange(before, place),
    listed: () => this.refreshList(),
    connection: (state) => this.header.setLive(state),
  });
  private readonly player = this.session.player;
  private readonly views = this.session.views;
  private readonly stage = new Stage();
  private readonly panel = new Panel(
    (agent) => this.choose(agent),
    (step) => this.player.seek(step * this.player.dt),
  );
  private readonly timeline: Timeline;
  private readonly list = new List(
    (ids, isCompared) => this.session.choose(ids, isCompared),
  );
  private readonly header: Header;
  private readonly legend = new Legend();
  private readonly toast = new Toast();
  private readonly help = helpDialog();
  private theme: Theme = DARK;
  private mode: Mode = "top";
  private shownRevision = -1;
  private hasFailed = false;
  private hasNoList = false;
  private isForced = true;
  private last = 0;
  private panelAt = 0;
  private linkAt = 0;
  private sightAt = 0;

  constructor() {
    this.timeline = new Timeline(
      {
        toggle: () => this.player.toggle(),
        seek: (t) => this.player.seek(t),
        step: (steps) => this.player.stepBy(steps),
        setSpeed: (speed) => this.player.setSpeed(speed),
        goLive: () => this.session.goLive(),
      },
      (marker) => this.chooseOf(marker),
    );
    this.header = new Header({
      list: () => this.list.toggle(),
      mode: (mode) => this.setMode(mode),
      fit: () => this.fit(true),
      theme: () => this.setTheme(this.theme === DARK ? "light" : "dark", true),
      link: () => void this.copyLink(),
      help: () => (this.help.open ? this.help.close() : this.help.showModal()),
      inStep: () => this.setInStep(!this.player.isInStep),
      panel: () => this.togglePanel(),
    });
    this.stage.element.append(this.legend.element);
    this.element.append(
      this.header.element,
      this.stage.element,
      this.panel.element,
      this.timeline.element,
      this.list.element,
      this.help,
      this.toast.element,
    );
    this.stage.onFocus = (index) => this.setFocus(index);
    this.stage.onExpand = (index) => this.session.choose([this.views[index].id]);
    this.stage.onPick = (view, place) => this.pick(view, place);
    this.setTheme(storedTheme(), false);
    this.listen();
  }

  async start(): Promise<void> {
    requestAnimationFrame((now) => this.frame(now));
    await this.session.start(parseLink(location.hash));
    this.element.dataset.ready = "yes";
    this.nameOpen();
    if (!this.views.length && !this.session.hasLive && !this.hasNoList) this.list.toggle();
  }

  private fail(text: string): void {
    this.hasNoList = true;
    this.stage.setNotice(text);
  }

  private get view(): View | null {
    return this.player.view;
  }

  /** Shows the views that are open now. */
  private arrange(before: ReadonlyMap<string, View>, place?: Place): void {
    this.stage.show(this.views);
    for (const view of this.views)
      if (!before.has(view.id) && this.mode !== view.rig.mode) view.rig.setMode(this.mode);
    if (place) this.restore(place);
    this.setFocus(Math.min(this.player.focus, Math.max(0, this.views.length - 1)));
    this.header.setGrid(this.views.length, this.player.isInStep);
    this.element.toggleAttribute("data-many", this.views.length > 1);
    this.player.syncEnds();
    this.refreshList();
    const fresh = this.views.filter((view) => !before.has(view.id));
    // Cells have their sizes only after the next picture.
    requestAnimationFrame(() => {
      for (const view of this.views) {
        const isRestored = place?.orbit && view === this.view;
        if (isRestored) view.isUnseen = false;
        else if (fresh.includes(view) || before.size !== this.views.length) this.look(view);
      }
      this.isForced = true;
    });
    const { clock } = this.player;
    if (fresh.length && !place) {
      clock.seek(clock.isLive ? clock.end : clock.begin);
      if (!clock.isPlaying) clock.play();
    }
    if (!place) this.nameOpen();
    this.element.toggleAttribute("data-empty", this.views.length === 0);
  }

  /** Has the address name what is open. Simulations that run open themselves. */
  private nameOpen(): void {
    if (this.element.dataset.ready && this.views.length && this.views.every((view) => !view.recording.isLive))
      history.replaceState(null, "", this.link(this.player.clock.isPlaying ? null : this.player.clock.t));
  }

  /** Turns the camera to where agents drive, once there is anything. */
  private look(view: View): void {
    view.isUnseen = !view.recording.map || !view.recording.length;
    if (view.isUnseen) return;
    view.rig.fit(view.region(), false);
    if (this.mode === "free") view.rig.tip();
  }

  private restore(place: Place): void {
    this.player.isInStep = place.isInStep;
    this.player.focus = Math.min(place.focus, Math.max(0, this.views.length - 1));
    this.player.syncEnds();
    for (const view of this.views) {
      view.clock.speed = place.speed;
      view.clock.seek(place.t);
      const agent = view.agents.find((each) => each.name === place.agent);
      if (agent) view.choose(agent);
    }
    this.player.shared.speed = place.speed;
    this.player.shared.seek(place.t);
    this.setMode(place.mode);
    if (place.orbit && this.view) Object.assign(this.view.rig.aim, place.orbit);
    if (!place.t && !location.hash.includes("t=")) this.player.clock.play();
  }

  /** A fragment that restores the view; without a time what is open, from its beginning. */
  private link(t: number | null = this.player.clock.t): string {
    const { view } = this;
    const isAimed = t !== null && view && !view.isUnseen && this.mode !== "follow";
    return formatLink({
      episodes: this.views.map((each) => each.id),
      t,
      speed: this.player.clock.speed,
      mode: this.mode,
      agent: view?.chosen?.name ?? "",
      focus: this.player.focus,
      isInStep: this.player.isInStep,
      orbit: isAimed ? view.rig.aim : null,
    });
  }

  private setFocus(index: number): void {
    this.player.focus = index;
    this.stage.setFocus(index);
    const { view } = this;
    this.panel.show(view);
    this.timeline.show(this.player.clock, view?.markers ?? [], this.player.dt);
    this.header.setTitle(view ? view.title : "Envision", view ? subtitle(view) : "no episode is open");
    this.legend.show(view?.recording ?? null);
    this.isForced = true;
  }

  private choose(agent: Agent): void {
    this.view?.choose(agent);
    this.panel.update();
  }

  private chooseOf(marker: Marker): void {
    const agent = this.view?.agents[marker.agent];
    if (agent) this.choose(agent);
  }

  private pick(view: View, place: number): void {
    this.setFocus(this.views.indexOf(view));
    const agent = view.agents[view.now.agent[place]];
    if (agent) this.choose(agent);
    else this.toast.say(vehicleText(view, place), 2500);
  }

  private setMode(mode: Mode): void {
    this.mode = mode;
    for (const view of this.views) view.rig.setMode(mode);
    this.header.setMode(mode);
    this.isForced = true;
  }

  private fit(isEased: boolean): void {
    this.setMode("top");
    for (const view of this.views) view.rig.fit(view.region(), isEased);
  }

  private setInStep(isInStep: boolean): void {
    this.player.setInStep(isInStep);
    this.header.setGrid(this.views.length, isInStep);
    this.setFocus(this.player.focus);
  }

  private setTheme(name: "dark" | "light", isKept: boolean): void {
    this.theme = name === "dark" ? DARK : LIGHT;
    document.documentElement.dataset.theme = name;
    this.legend.paint(this.theme);
    this.isForced = true;
    if (isKept) keep("theme", name);
  }

  private togglePanel(): void {
    this.element.toggleAttribute("data-panel-closed");
    this.element.toggleAttribute("data-panel-open");
  }

  private refreshList(): void {
    const { entries } = this.session;
    this.list.show(
      entries,
      this.views.map((view) => view.id),
      this.session.hidden,
    );
    this.header.setCount(entries.length);
  }

  private async copyLink(): Promise<void> {
    history.replaceState(null, "", this.link());
    try {
      await navigator.clipboard.writeText(location.href);
      this.toast.say("The link to this view is copied.", 2500);
    } catch {
      this.toast.say("The link to this view is in the address bar.", 2500);
    }
  }

  private listen(): void {
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("hashchange", () => {
      const place = parseLink(location.hash);
      const open = this.views.map((view) => view.id);
      void this.session.open(place.episodes.length ? place.episodes : open, place).then(() => this.nameOpen());
    });
    this.list.element.addEventListener("toggle", () => {
      if (this.list.element.open) void this.session.listAgain();
    });
  }

  private key(event: KeyboardEvent): void {
    if (this.list.element.open || event.ctrlKey || event.metaKey || event.altKey) return;
    const action = keyAction(event);
    if (!action) return;
    event.preventDefault();
    const run: Record<string, () => void> = {
      toggle: () => this.player.toggle(),
      before: () => this.player.stepBy(-1),
      after: () => this.player.stepBy(1),
      back: () => this.player.seek(this.player.clock.t - 5),
      forward: () => this.player.seek(this.player.clock.t + 5),
      begin: () => this.player.seek(this.player.clock.begin),
      end: () => this.player.seek(this.player.clock.end),
      previous: () => this.timeline.jump(-1),
      next: () => this.timeline.jump(1),
      slower: () => this.player.changeSpeed(-1),
      faster: () => this.player.changeSpeed(1),
      top: () => this.setMode("top"),
      follow: () => this.setMode("follow"),
      free: () => this.setMode("free"),
      fit: () => this.fit(true),
      agent: () => this.nextAgent(event.shiftKey ? -1 : 1),
      cell: () => this.views.length && this.setFocus((this.player.focus + 1) % this.views.length),
      list: () => this.list.toggle(),
      theme: () => this.setTheme(this.theme === DARK ? "light" : "dark", true),
      inStep: () => this.setInStep(!this.player.isInStep),
      panel: () => this.togglePanel(),
      help: () => (this.help.open ? this.help.close() : this.help.showModal()),
      closer: () => this.zoom(0.85),
      farther: () => this.zoom(1.18),
      link: () => void this.copyLink(),
    };
    run[action]?.();
  }

  private zoom(factor: number): void {
    this.view?.rig.zoom(factor);
    this.isForced = true;
  }

  private nextAgent(sign: number): void {
    const { view } = this;
    if (!view?.agents.length) return;
    const place = view.agents.findIndex((agent) => agent.row === view.chosen?.row);
    this.choose(view.agents[(place + sign + view.agents.length) % view.agents.length]);
  }

  /** Draws a picture if anything has changed. */
  private frame(now: number): void {
    requestAnimationFrame((next) => this.frame(next));
    const elapsed = Math.min(0.25, (now - this.last) / 1000);
    this.last = now;
    try {
      this.draw(now, elapsed);
    } catch (error) {
      // A page that stands still says why, once.
      if (!this.hasFailed) this.toast.say(`The picture cannot be drawn: ${reason(error)}`);
      if (!this.hasFailed) console.error(error);
      this.hasFailed = true;
    }
  }

  private draw(now: number, elapsed: number): void {
    const hasMoved = this.advance(elapsed) || this.isForced;
    this.stage.draw(elapsed, this.theme, hasMoved);
    this.isForced = false;
    if (hasMoved) this.timeline.tick(now);
    if (now - this.panelAt > PANEL_RATE) {
      this.panelAt = now;
      this.timeline.tick(now);
      this.panel.update();
      this.views.forEach((view, i) => this.stage.setStatus(i, ...statusOf(view)));
    }
    if (now - this.sightAt > SIGHT_RATE) {
      this.sightAt = now;
      this.session.observe();
    }
    if (
      now - this.linkAt > LINK_RATE &&
      !this.player.clock.isPlaying &&
      this.views.length &&
      this.element.dataset.ready
    ) {
      this.linkAt = now;
      const link = this.link();
      if (link !== location.hash) history.replaceState(null, "", link);
    }
  }

  private advance(elapsed: number): boolean {
    if (this.session.takeUp()) this.refreshLive();
    return this.player.advance(elapsed);
  }

  private refreshLive(): void {
    const { view } = this;
    if (view && view.revision !== this.shownRevision) {
      this.shownRevision = view.revision;
      this.timeline.show(this.player.clock, view.markers, this.player.dt);
      this.legend.show(view.recording);
      this.header.setTitle(view.title, subtitle(view));
    }
    for (const each of this.views) if (each.isUnseen) this.look(each);
    this.isForced = true;
  }
}
