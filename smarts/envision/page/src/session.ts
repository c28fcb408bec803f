/** What is open: recordings and simulations that run, as views with their clocks. */

import { type Entry, findLibrary, type Library, listEpisodes, NOTHING } from "./library";
import type { Place } from "./link";
import { LiveFeed } from "./livefeed";
import type { LiveState } from "./live";
import { Player } from "./player";
import { reason, titleOf, titlesOf } from "./titles";
import { View } from "./view";

export const MOST_VIEWS = 9;
/** From one list of episodes that the server is still reading to the next [ms]. */
const LIST_PAUSE = 2000;

interface Actions {
  say(text: string): void;
  /** Nothing can be shown; the reason stays on the page. */
  fail(text: string): void;
  /** Other views are open than before; `before` has those that were, by id. */
  arranged(before: ReadonlyMap<string, View>, place?: Place): void;
  listed(): void;
  connection(state: LiveState): void;
}

export class Session {
  readonly player = new Player();
  readonly views = this.player.views;
  library: Library = NOTHING;
  private feed: LiveFeed | null = null;
  /** Whether simulations that run are shown without being asked for; those in `pending` first. */
  private isAutomatic = true;
  private pending: readonly string[] = [];
  /** Simulations that have begun another episode while the user looks at the past of the one before. */
  private readonly waiting = new Set<string>();
  /** Counts calls of `open`: one that takes long does not undo a later one. */
  private turn = 0;
  /** Counts calls of `listAgain`: the last one asks. */
  private listing = 0;
  /** Whether the user was told that there are more simulations than are listed. */
  private hasTold = false;
  /** The agents whose observations were asked for last. */
  private asked = "{}";

  constructor(private readonly actions: Actions) {}

  get entries(): Entry[] {
    return [...(this.feed?.entries ?? []), ...this.library.entries];
  }

  /** How many simulations run that are not listed. */
  get hidden(): number {
    return this.feed?.hidden ?? 0;
  }

  /** Asks for what the chosen agents of running simulations observe, where they have changed. */
  observe(): void {
    const chosen = this.views.filter(({ recording, chosen }) => recording.isLive && chosen);
    const agents = Object.fromEntries(chosen.map(({ id, chosen }) => [id, chosen!.row]));
    const asked = JSON.stringify(agents);
    if (!this.feed || asked === this.asked) return;
    this.asked = asked;
    this.feed.observe(agents);
  }

  get hasLive(): boolean {
    return this.feed !== null;
  }

  /** Finds the library and opens what the link names, or else the first episode. */
  async start(place: Place): Promise<void> {
    try {
      this.library = await findLibrary();
    } catch (error) {
      this.actions.fail(`The episodes cannot be listed: ${reason(error)}`);
    }
    const { library } = this;
    this.pending = place.episodes;
    if (library.hasLive) this.startLive();
    const bad = library.isTogether ? library.entries.find((entry) => entry.error) : undefined;
    if (bad) this.actions.say(`${bad.label} cannot be opened: ${bad.error}`);
    const known = library.entries.filter((entry) => !entry.error).map((entry) => entry.id);
    const wanted = place.episodes.filter((id) => known.includes(id));
    await this.open(wanted.length ? wanted : known.slice(0, library.isTogether ? MOST_VIEWS : 1), place);
    this.nameMissing(place.episodes, wanted);
    if (library.entries.some((entry) => entry.isUnread)) void this.listAgain();
  }

  /** Asks for the list until the server has read all that is in it; without an answer, the list stays. */
  async listAgain(): Promise<void> {
    const { library } = this;
    if (!library.isServed) return;
    const listing = ++this.listing;
    try {
      while (this.library === library && listing === this.listing) {
        library.entries = await listEpisodes();
        this.actions.listed();
        if (!library.entries.some((entry) => entry.isUnread)) return;
        await new Promise((resolve) => setTimeout(resolve, LIST_PAUSE));
      }
    } catch {
      // It is asked for again when the list is opened.
    }
  }

  /** Says which episodes of a link are not opened; a simulation that it names may still come. */
  private nameMissing(named: readonly string[], opened: readonly string[]): void {
    if (this.hasLive) return;
    const missing = named.filter((id) => !opened.includes(id));
    const why = missing.map((id) => {
      const entry = this.library.entries.find((each) => each.id === id);
      return entry ? `${entry.label} cannot be opened: ${entry.error}` : `There is no episode ${id} here`;
    });
    if (!missing.length) return;
    const shown = !opened.length && this.views.length ? `. Instead: ${this.views.map((view) => view.title).join("; ")}` : "";
    this.actions.say(`${why.join(". ")}${shown}`);
  }

  private startLive(): void {
    this.feed = new LiveFeed({
      changed: () => this.takeSources(),
      replaced: (id) => void this.reopenLive(id),
      state: (state) => this.actions.connection(state),
      problem: (text) => this.actions.say(text),
    });
    this.feed.connect();
  }

  /** Shows simulations that have appeared, until the user chooses. */
  private takeSources(): void {
    const ids = this.feed?.ids ?? [];
    if (this.hidden && !this.hasTold)
      this.actions.say(`The first ${ids.length} simulations are shown; ${this.hidden} more run.`);
    this.hasTold = this.hidden > 0;
    const wanted = this.pending.filter((id) => ids.includes(id));
    const shown = (wanted.length ? wanted : ids).slice(0, MOST_VIEWS);
    const isNew = shown.some((id) => !this.views.some((view) => view.id === id));
    if (this.isAutomatic && isNew && this.views.every((view) => view.recording.isLive)) {
      // Simulations have times of their own.
      this.player.isInStep = false;
      void this.open(shown);
    } else this.actions.listed();
  }

  /** Opens what the user has chosen; several that are compared go in step. */
  choose(ids: readonly string[], isCompared = false): void {
    this.isAutomatic = false;
    if (isCompared) this.player.isInStep = true;
    void this.open(ids).then(() => this.nameRest(ids));
  }

  /** Says which of the chosen episodes are not shown since there is no room for them. */
  private nameRest(ids: readonly string[]): void {
    if (ids.length <= MOST_VIEWS) return;
    const chosen = ids.map((id) => this.entries.find((entry) => entry.id === id)).filter((entry) => entry !== undefined);
    const rest = titlesOf(chosen).slice(MOST_VIEWS);
    this.actions.say(`${MOST_VIEWS} of ${chosen.length} episodes are shown, not: ${rest.join("; ")}`);
  }

  /** Opens recordings in a grid; those that are open stay as they are. */
  async open(ids: readonly string[], place?: Place): Promise<void> {
    const turn = ++this.turn;
    const before = new Map(this.views.map((view) => [view.id, view]));
    const wanted = [...new Set(ids)].slice(0, MOST_VIEWS);
    const found = await Promise.all(wanted.map(async (id) => before.get(id) ?? (await this.load(id))));
    const views = found.filter((view) => view !== null);
    if (turn !== this.turn || (!views.length && ids.length)) {
      for (const view of views) if (!before.has(view.id)) view.dispose();
      return;
    }
    for (const view of this.views) if (!views.includes(view)) view.dispose();
    this.views.splice(0, Infinity, ...views);
    this.nameViews();
    this.feed?.watch(views.map((view) => view.id));
    this.actions.arranged(before, place);
  }

  /** Gives views titles by which they can be told apart. */
  private nameViews(): void {
    const entries = this.views.map(({ id }) => this.entries.find((entry) => entry.id === id));
    const known = entries.filter((entry) => entry !== undefined);
    const titles = titlesOf(known);
    for (const view of this.views) {
      const place = known.findIndex((entry) => entry.id === view.id);
      if (place >= 0) view.title = titles[place];
    }
  }

  private async load(id: string): Promise<View | null> {
    const entry = this.entries.find((each) => each.id === id);
    const live = this.feed?.recording(id);
    try {
      const recording = live ?? (await this.library.load(id));
      if (recording.remark && !live) this.actions.say(`${entry?.label ?? id}: ${recording.remark}`);
      const view = new View(id, titleOf(entry, id), recording);
      if (this.feed?.ids.includes(id)) {
        view.clock.isLive = true;
        view.clock.play();
      }
      return view;
    } catch (error) {
      this.actions.say(`${entry?.label ?? id} cannot be opened: ${reason(error)}`);
      return null;
    }
  }

  /** Shows the next episode of a simulation that runs; not while the user looks at the past of this one. */
  private async reopenLive(id: string): Promise<void> {
    const clock = this.views.find((view) => view.id === id)?.clock;
    if (clock?.isLive && clock.end > clock.begin && !(clock.isPlaying && clock.isFollowing)) {
      this.waiting.add(id);
      return;
    }
    this.waiting.delete(id);
    const fresh = this.views.some((view) => view.id === id) ? await this.load(id) : null;
    const index = this.views.findIndex((view) => view.id === id);
    if (!fresh || index < 0) {
      fresh?.dispose();
      return;
    }
    const old = this.views[index];
    Object.assign(fresh.rig.aim, old.rig.aim);
    fresh.isUnseen = old.isUnseen;
    fresh.rig.setMode(old.rig.mode);
    fresh.clock.speed = old.clock.speed;
    old.dispose();
    this.views[index] = fresh;
    this.actions.arranged(new Map(this.views.map((view) => [view.id, view])));
  }

  /** Goes to what is newest. */
  goLive(): void {
    this.player.goLive();
    this.takeWaiting();
  }

  /** Shows the next episode where the user has come back to the end of the one before. */
  private takeWaiting(): void {
    for (const id of this.waiting) {
      const clock = this.views.find((view) => view.id === id)?.clock;
      if (!clock) this.waiting.delete(id);
      else if (clock.isPlaying && clock.isFollowing) void this.reopenLive(id);
    }
  }

  /** Takes up what has come from simulations that run; returns whether there was anything. */
  takeUp(): boolean {
    this.takeWaiting();
    if (!this.feed?.takeUp(this.views)) return false;
    this.player.syncEnds();
    return true;
  }
}
