/** Recordings that grow: one for each simulation that is watched, and the episodes that they had before. */

import { describe, type Entry } from "./library";
import { Live, type LiveState } from "./live";
import type { EpisodeMessage, Message, Source } from "./messages";
import { Recording } from "./episode";
import type { View } from "./view";

/** Episodes that are over and can still be opened, of all simulations together. */
const MOST_PAST = 12;
const FEWEST_STEPS = 5;
/** Bytes of states of all simulations and their past episodes together. */
const MOST_BYTES = 128 << 20;
/** A simulation whose episode was cut short has begun another one after this time, or never does [ms]. */
export const PATIENCE = 2000;

interface Actions {
  changed(): void;
  /** A simulation has begun another episode. */
  replaced(id: string): void;
  state(state: LiveState): void;
  problem(text: string): void;
}

interface Past {
  entry: Entry;
  recording: Recording;
}

export class LiveFeed {
  private readonly live = new Live();
  private readonly recordings = new Map<string, Recording>();
  private readonly past = new Map<string, Past>();
  private counted = 0;
  private hasNews = false;

  constructor(
    private readonly actions: Actions,
    private readonly most = MOST_BYTES,
  ) {
    this.live.onSources = () => actions.changed();
    this.live.onState = (state) => actions.state(state);
    this.live.onMessage = (source, message, isAgain) => this.take(source, message, isAgain);
    this.live.onProblem = (text) => actions.problem(text);
  }

  connect(): void {
    this.live.connect();
  }

  /** What runs, then what has ended, the newest first. */
  get entries(): Entry[] {
    return [...this.live.sources.map(entryOf), ...[...this.past.values()].map(({ entry }) => entry).reverse()];
  }

  /** The ids of the listed simulations: running ones first, then those that have ended. */
  get ids(): string[] {
    const { sources } = this.live;
    return [...sources.filter(({ running }) => running), ...sources.filter(({ running }) => !running)].map(({ id }) => id);
  }

  /** The recording of a simulation that runs, which fills when its messages come, or of an episode before. */
  recording(id: string): Recording | null {
    const known = this.recordings.get(id) ?? this.past.get(id)?.recording;
    if (known || !this.ids.includes(id)) return known ?? null;
    const recording = new Recording([], true);
    this.recordings.set(id, recording);
    return recording;
  }

  watch(ids: readonly string[]): void {
    const known = ids.filter((id) => this.ids.includes(id));
    for (const id of this.recordings.keys()) if (!known.includes(id)) this.recordings.delete(id);
    this.live.watch(known);
  }

  /** How many simulations run that are not listed. */
  get hidden(): number {
    return this.live.hidden;
  }

  /** Asks for what an agent of each simulation observes. */
  observe(agents: Readonly<Record<string, number>>): void {
    this.live.observe(agents);
  }

  private take(source: string, message: Message, isAgain: boolean): void {
    const known = this.recordings.get(source);
    // The server sends a snapshot to one that was too slow: the episode goes on, with a gap.
    const isSame = isAgain && message.type === "episode" && known !== undefined && isOf(known, message);
    if (message.type === "episode" && !isSame) {
      this.keep(source);
      this.recordings.set(source, new Recording([message], true));
      this.actions.replaced(source);
    } else known?.add(message);
    if (message.type === "steps") this.fit();
    if (message.type === "end" && !message.isComplete) this.watchOver(source, message.remark);
    this.hasNews = true;
  }

  /** Says why an episode was cut short, unless its simulation begins another one. */
  private watchOver(source: string, remark: string): void {
    const recording = this.recordings.get(source);
    const title = this.titleOf(source);
    setTimeout(() => {
      if (recording && this.recordings.get(source) === recording) this.actions.problem(`${title}: ${remark}`);
    }, PATIENCE);
  }

  private titleOf(source: string): string {
    return this.live.sources.find((each) => each.id === source)?.title || source;
  }

  /** Keeps the episode that a simulation has had until now. */
  private keep(source: string): void {
    const recording = this.recordings.get(source);
    if (!recording || recording.length < FEWEST_STEPS) return;
    const title = this.titleOf(source);
    const number = Number(recording.facts.episode);
    const label = Number.isFinite(number) ? `${title}, episode ${number}` : title;
    const id = `past${this.counted++}`;
    this.past.set(id, { entry: { ...describe(id, recording, label), run: "live until now" }, recording });
    for (const oldest of this.past.keys()) if (this.past.size > MOST_PAST) this.past.delete(oldest);
    this.actions.changed();
  }

  /** The memory that live and past states take. */
  get bytes(): number {
    const past = [...this.past.values()].map(({ recording }) => recording);
    return [...this.recordings.values(), ...past].reduce((sum, { bytes }) => sum + bytes, 0);
  }

  /** Forgets the oldest episode until all fit, or else half of the largest one that runs. */
  private fit(): void {
    while (this.bytes > this.most) {
      const [oldest] = this.past.keys();
      const largest = [...this.recordings.values()].reduce((a, b) => (b.bytes > a.bytes ? b : a));
      if (oldest !== undefined) {
        this.past.delete(oldest);
        this.actions.changed();
      } else if (largest.length > FEWEST_STEPS) largest.forget();
      else return;
    }
  }

  /** Brings views up to date; returns whether there was anything. */
  takeUp(views: readonly View[]): boolean {
    if (!this.hasNews) return false;
    this.hasNews = false;
    for (const view of views)
      if (view.recording.isLive) {
        view.refresh();
        // What is put off for a moment is not to wait for the next message, which may never come.
        this.hasNews ||= !view.isCurrent;
      }
    return true;
  }
}

/** Whether a recording is of the episode that a message begins. */
function isOf(recording: Recording, { facts }: EpisodeMessage): boolean {
  const names = Object.keys(facts);
  const isEqual = names.every((name) => recording.facts[name] === facts[name]);
  return isEqual && names.length > 0 && names.length === Object.keys(recording.facts).length;
}

function entryOf(source: Source): Entry {
  return {
    id: source.id,
    label: source.title || source.id,
    run: source.host,
    scenario: source.scenario || source.title,
    traffic: "",
    episode: source.episode || 0,
    seed: 0,
    world: source.world || 0,
    seconds: 0,
    agents: 0,
    outcomes: {},
    isComplete: false,
    pair: "",
    policy: source.policy,
    why: "",
    error: "",
    isUnread: false,
    isLive: true,
    isRunning: source.running,
  };
}
