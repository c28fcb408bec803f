/** The page: what is open, what is chosen, one clock or several, and the keys. */

import type { Agent, Marker } from "./agents";
import { h } from "./dom";
import { Header } from "./header";
import { helpDialog } from "./help";
import { keyAction } from "./keys";
import { Legend } from "./legend";
import { type Entry, findLibrary, fromFiles, type Library, listEpisodes } from "./library";
import { formatLink, parseLink, type Place } from "./link";
import { List } from "./list";
import { LiveFeed } from "./livefeed";
import { Panel } from "./panel";
import { Player } from "./player";
import type { Mode } from "./scene/camera";
import { DARK, LIGHT, type Theme } from "./scene/palette";
import { keep, storedTheme } from "./settings";
import { Stage } from "./stage";
import { Timeline } from "./timeline";
import { reason, statusOf, subtitle, titleOf } from "./titles";
import { View } from "./view";

const MOST = 9;
const PANEL_RATE = 90;
const LINK_RATE = 700;

export class App {
  readonly element = h("div", { class: "app" });
  private readonly player = new Player();
  private readonly views = this.player.views;
  private library: Library = {
    entries: [],
    hasLive: false,
    isTogether: false,
    load: () => Promise.reject(new Error("nothing is open")),
  };
  private readonly stage = new Stage();
  private readonly panel = new Panel(
    (agent) => this.choose(agent),
    (step) => this.player.seek(step * this.player.dt),
  );
  private readonly timeline: Timeline;
  private readonly list = new List(
    (ids) => this.openChosen(ids),
    (files) => void this.openFiles(files),
  );
  private readonly header: Header;
  private readonly legend = new Legend();
  private readonly toast = h("div", { class: "toast", role: "alert", hidden: true });
  private readonly help = helpDialog();
  private feed: LiveFeed | null = null;
  private theme: Theme = DARK;
  private mode: Mode = "top";
  private shownRevision = -1;
  /** Whether simulations that run are shown without being asked for; those in `pending` first. */
  private isAutomatic = true;
  private pending: readonly string[] = [];
  private isForced = true;
  private last = 0;
  private panelAt = 0;
  private linkAt = 0;

  constructor() {
    this.timeline = new Timeline(
      {
        toggle: () => this.player.toggle(),
        seek: (t) => this.player.seek(t),
        step: (steps) => this.player.stepBy(steps),
        setSpeed: (speed) => this.player.setSpeed(speed),
        goLive: () => this.player.goLive(),
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
      this.toast,
    );
    this.stage.onFocus = (index) => this.setFocus(index);
    this.stage.onExpand = (index) => this.openChosen([this.views[index].id]);
    this.stage.onPick = (view, place) => this.pick(view, place);
    this.setTheme(storedTheme(), false);
    this.listen();
  }

  async start(): Promise<void> {
    requestAnimationFrame((now) => this.frame(now));
    const place = parseLink(location.hash);
    try {
      this.library = await findLibrary();
    } catch (error) {
      this.say(`The server cannot be reached: ${reason(error)}`);
    }
    this.pending = place.episodes;
    if (this.library.hasLive) this.startLive();
    const known = this.library.entries.filter((entry) => !entry.error).map((entry) => entry.id);
    const wanted = place.episodes.filter((id) => known.includes(id));
    const first = wanted.length ? wanted : known.slice(0, this.library.isTogether ? MOST : 1);
    await this.open(first, place);
    this.element.dataset.ready = "yes";
    if (!first.length && !this.library.hasLive) this.list.toggle();
  }

  private startLive(): void {
    this.feed = new LiveFeed({
      changed: () => this.takeSources(),
      replaced: (id) => void this.reopenLive(id),
      state: (state) => this.header.setLive(state),
    });
    this.feed.connect();
  }

  /** Shows simulations that have appeared, until the user chooses. */
  private takeSources(): void {
    const ids = this.feed?.entries.map((entry) => entry.id) ?? [];
    const wanted = this.pending.filter((id) => ids.includes(id));
    const shown = (wanted.length ? wanted : ids).slice(0, MOST);
    const isNew = shown.some((id) => !this.views.some((view) => view.id === id));
    if (this.isAutomatic && isNew && this.views.every((view) => view.recording.isLive)) {
      // Simulations have times of their own.
      this.player.isInStep = false;
      void this.open(shown);
    }
    else this.refreshList();
  }

  private get view(): View | null {
    return this.player.view;
  }

  private get entries(): Entry[] {
    return [...(this.feed?.entries ?? []), ...this.library.entries];
  }

  private openChosen(ids: readonly string[]): void {
    this.isAutomatic = false;
    void this.open(ids);
  }

  /** Opens recordings in a grid; those that are open stay as they are. */
  async open(ids: readonly string[], place?: Place): Promise<void> {
    const before = new Map(this.views.map((view) => [view.id, view]));
    const views: View[] = [];
    for (const id of ids.slice(0, MOST)) {
      const view = before.get(id) ?? (await this.load(id));
      if (view) views.push(view);
    }
    if (!views.length && ids.length) return;
    for (const view of this.views) if (!views.includes(view)) view.dispose();
    this.views.splice(0, Infinity, ...views);
    this.feed?.watch(views.map((view) => view.id));
    this.arrange(before, place);
  }

  private arrange(before: Map<string, View>, place?: Place): void {
    this.stage.show(this.views);
    for (const view of this.views)
      if (!before.has(view.id) && this.mode !== view.rig.mode) view.rig.setMode(this.mode);
    if (place) this.restore(place);
    this.setFocus(Math.min(this.player.focus, Math.max(0, this.views.length - 1)));
    this.header.setGrid(this.views.length, this.player.isInStep);
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
    if (fresh.length && !place) {
      this.player.clock.seek(this.player.clock.begin);
      if (!this.player.clock.isPlaying) this.player.clock.play();
    }
    this.element.toggleAttribute("data-empty", this.views.length === 0);
  }

  /** Turns the camera to where agents drive, once there is anything. */
  private look(view: View): void {
    view.isUnseen = !view.recording.map || !view.recording.length;
    if (view.isUnseen) return;
    view.rig.fit(view.region(), false);
    if (this.mode === "free") view.rig.tip();
  }

  private async load(id: string): Promise<View | null> {
    const entry = this.entries.find((each) => each.id === id);
    const live = this.feed?.recording(id);
    try {
      const recording = live ?? (await this.library.load(id));
      if (recording.remark && !live) this.say(`${entry?.label ?? id}: ${recording.remark}`);
      const view = new View(id, titleOf(entry, id), recording);
      if (live) {
        view.clock.isLive = true;
        view.clock.play();
      }
      return view;
    } catch (error) {
      this.say(`${entry?.label ?? id} cannot be opened: ${reason(error)}`);
      return null;
    }
  }

  /** Shows the next episode of a simulation that runs. */
  private async reopenLive(id: string): Promise<void> {
    const index = this.views.findIndex((view) => view.id === id);
    if (index < 0) return;
    const old = this.views[index];
    const fresh = await this.load(id);
    if (!fresh) return;
    Object.assign(fresh.rig.aim, old.rig.aim);
    fresh.isUnseen = old.isUnseen;
    fresh.rig.setMode(old.rig.mode);
    old.dispose();
    const before = new Map(this.views.map((view) => [view.id, view]));
    this.views[index] = fresh;
    before.set(id, fresh);
    this.arrange(before);
  }

  private async openFiles(files: File[]): Promise<void> {
    try {
      const library = await fromFiles(files);
      const { feed } = this;
      this.library = library;
      for (const view of this.views) view.dispose();
      this.views.length = 0;
      if (feed) feed.watch([]);
      this.list.element.close();
      await this.open(library.entries.map((entry) => entry.id).slice(0, MOST));
    } catch (error) {
      this.say(`${files.map((file) => file.name).join(", ")} cannot be opened: ${reason(error)}`);
    }
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

  private place(): Place {
    const { view } = this;
    const orbit = view && this.mode !== "follow" ? view.rig.aim : null;
    return {
      episodes: this.views.map((each) => each.id),
      t: this.player.clock.t,
      speed: this.player.clock.speed,
      mode: this.mode,
      agent: view?.chosen?.name ?? "",
      focus: this.player.focus,
      isInStep: this.player.isInStep,
      orbit,
    };
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
    else
      this.say(
        `${view.recording.vehicles[view.now.number[place]]?.name || "a vehicle"}: ${view.now.speed[place].toFixed(1)} m/s, driven by traffic`,
        2500,
      );
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
    this.list.show(
      this.entries,
      this.views.map((view) => view.id),
    );
    this.header.setCount(this.entries.length);
  }

  private async copyLink(): Promise<void> {
    const link = location.href.replace(/#.*$/, "") + formatLink(this.place());
    history.replaceState(null, "", formatLink(this.place()));
    try {
      await navigator.clipboard.writeText(link);
      this.say("The link to this view is copied.", 2500);
    } catch {
      this.say("The link to this view is in the address bar.", 2500);
    }
  }

  private say(message: string, duration = 9000): void {
    this.toast.textContent = message;
    this.toast.hidden = false;
    setTimeout(() => {
      if (this.toast.textContent === message) this.toast.hidden = true;
    }, duration);
  }

  private listen(): void {
    addEventListener("keydown", (event) => this.key(event));
    addEventListener("hashchange", () => {
      const place = parseLink(location.hash);
      void this.open(place.episodes, place);
    });
    this.element.addEventListener("dragover", (event) => event.preventDefault());
    this.element.addEventListener("drop", (event) => {
      event.preventDefault();
      const files = [...(event.dataTransfer?.files ?? [])];
      if (files.length) void this.openFiles(files);
    });
    this.list.element.addEventListener("toggle", () => {
      if (this.list.element.open && location.protocol.startsWith("http") && this.library.entries.length)
        void listEpisodes().then(
          (entries) => {
            this.library.entries = entries;
            this.refreshList();
          },
          () => undefined,
        );
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
    const hasMoved = this.advance(elapsed) || this.isForced;
    this.stage.draw(elapsed, this.theme, hasMoved);
    this.isForced = false;
    if (hasMoved) this.timeline.update();
    if (now - this.panelAt > PANEL_RATE) {
      this.panelAt = now;
      this.timeline.update();
      this.panel.update();
      this.views.forEach((view, i) => this.stage.setStatus(i, ...statusOf(view)));
    }
    if (
      now - this.linkAt > LINK_RATE &&
      !this.player.clock.isPlaying &&
      this.views.length &&
      this.element.dataset.ready
    ) {
      this.linkAt = now;
      const link = formatLink(this.place());
      if (link !== location.hash) history.replaceState(null, "", link);
    }
  }

  private advance(elapsed: number): boolean {
    if (this.feed?.takeUp(this.views)) this.refreshLive();
    return this.player.advance(elapsed);
  }

  private refreshLive(): void {
    this.player.syncEnds();
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
