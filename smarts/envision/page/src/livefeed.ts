/** Recordings that grow: one for each simulation that is watched. */

import { Recording } from "./episode";
import type { Message, Source } from "./format";
import type { Entry } from "./library";
import { Live, type LiveState } from "./live";
import type { View } from "./view";

interface Actions {
  changed(): void;
  /** A simulation has begun another episode. */
  replaced(id: string): void;
  state(state: LiveState): void;
}

export class LiveFeed {
  private readonly live = new Live();
  private readonly recordings = new Map<string, Recording>();
  private hasNews = false;

  constructor(private readonly actions: Actions) {
    this.live.onSources = () => actions.changed();
    this.live.onState = (state) => actions.state(state);
    this.live.onMessage = (source, message) => this.take(source, message);
  }

  connect(): void {
    this.live.connect();
  }

  get entries(): Entry[] {
    return this.live.sources.map(entryOf);
  }

  /** The recording of a simulation that runs; it fills when its messages come. */
  recording(id: string): Recording | null {
    const known = this.recordings.get(id);
    if (known || !this.live.sources.some((source) => source.id === id)) return known ?? null;
    const recording = new Recording([], true);
    this.recordings.set(id, recording);
    return recording;
  }

  watch(ids: readonly string[]): void {
    const known = ids.filter((id) => this.live.sources.some((source) => source.id === id));
    for (const id of this.recordings.keys()) if (!known.includes(id)) this.recordings.delete(id);
    this.live.watch(known);
  }

  private take(source: string, message: Message): void {
    if (message.type === "episode") {
      const fresh = new Recording([message], true);
      this.recordings.set(source, fresh);
      this.actions.replaced(source);
    } else this.recordings.get(source)?.add(message);
    this.hasNews = true;
  }

  /** Brings views up to date; returns whether there was anything. */
  takeUp(views: readonly View[]): boolean {
    if (!this.hasNews) return false;
    this.hasNews = false;
    for (const view of views) if (view.recording.isLive) view.refresh();
    return true;
  }
}

function entryOf(source: Source): Entry {
  return {
    id: source.id,
    label: source.title || source.id,
    run: source.host,
    scenario: source.scenario || source.title,
    traffic: "",
    episode: source.episode,
    seconds: 0,
    agents: 0,
    outcomes: {},
    isComplete: false,
    pair: "",
    policy: source.title,
    error: "",
    isLive: true,
  };
}
