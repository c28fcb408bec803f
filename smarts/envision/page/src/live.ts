/** Simulations that run now: one WebSocket, which comes back by itself. */

import { decode } from "./format";
import type { Address, MapMessage, Message, Source } from "./messages";

/** Maps that are kept, the last ones: the server knows how many, and sends these no more. */
const MOST_MAPS = 16;
const SHORTEST_WAIT = 500;
const LONGEST_WAIT = 10_000;

export type LiveState = "connecting" | "connected" | "lost";

export class Live {
  sources: Source[] = [];
  /** How many simulations run that are not among them. */
  hidden = 0;
  state: LiveState = "connecting";
  onSources: (sources: Source[]) => void = () => {};
  /** The last argument says whether a message `episode` is of the one that this connection has sent before. */
  onMessage: (source: string, message: Message, isAgain: boolean) => void = () => {};
  onState: (state: LiveState) => void = () => {};
  onProblem: (text: string) => void = () => {};
  private socket: WebSocket | null = null;
  private watched: readonly string[] = [];
  private observed: Readonly<Record<string, number>> = {};
  private readonly maps = new Map<string, MapMessage>();
  private wait = SHORTEST_WAIT;
  private chain: Promise<void> = Promise.resolve();
  private readonly serials = new Map<string, number>();

  connect(): void {
    const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.addEventListener("open", () => {
      this.wait = SHORTEST_WAIT;
      this.setState("connected");
      this.tell();
    });
    socket.addEventListener("message", (event: MessageEvent<unknown>) => {
      if (!(event.data instanceof ArrayBuffer)) return;
      const bytes = new Uint8Array(event.data);
      // Messages are decoded side by side and taken up in order.
      const decoded = decode(bytes).catch((error: unknown) => ({
        type: "error" as const,
        text: `a message of a simulation is damaged: ${error instanceof Error ? error.message : String(error)}`,
        source: "",
        serial: 0,
      }));
      this.chain = this.chain.then(async () => {
        const message = await decoded;
        try {
          // What a connection that is gone has left behind would mix with the next one's.
          if (this.socket === socket) this.take(message);
        } catch (error) {
          this.onProblem(`a message of a simulation cannot be shown: ${String(error)}`);
        }
      });
    });
    socket.addEventListener("close", () => {
      this.setState("lost");
      this.serials.clear();
      this.maps.clear();
      setTimeout(() => this.connect(), this.wait);
      this.wait = Math.min(LONGEST_WAIT, 1.7 * this.wait);
    });
  }

  /** Asks for the states of these simulations. */
  watch(ids: readonly string[]): void {
    this.watched = ids;
    this.tell();
  }

  /** Asks for what an agent of each simulation observes; agents are rows of their tables. */
  observe(agents: Readonly<Record<string, number>>): void {
    this.observed = agents;
    this.tell();
  }

  private tell(): void {
    const request = { watch: this.watched, observe: this.observed };
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(request));
  }

  private take(message: (Message & Address) | null): void {
    if (!message) return;
    if (message.type === "sources") {
      this.sources = message.sources;
      this.hidden = message.hidden;
      this.onSources(message.sources);
      return;
    }
    if (message.type === "error") {
      this.onProblem(message.text);
      return;
    }
    const { source, serial } = message;
    const isAgain = this.serials.get(source) === serial;
    if (message.type === "episode") this.serials.set(source, serial);
    if (message.type === "map") this.keepMap(message);
    if (message.type !== "episode" && !isAgain) return;
    const map = message.type === "known_map" ? this.maps.get(message.digest) : undefined;
    if (message.type === "known_map" && !map) throw new Error("its map is missing");
    this.onMessage(source, map ?? message, isAgain);
  }

  private keepMap(map: MapMessage): void {
    this.maps.delete(map.digest);
    this.maps.set(map.digest, map);
    for (const oldest of this.maps.keys()) if (this.maps.size > MOST_MAPS) this.maps.delete(oldest);
  }

  private setState(state: LiveState): void {
    this.state = state;
    this.onState(state);
  }
}
