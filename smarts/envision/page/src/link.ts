/** The view as a URL fragment, so that a link restores it. */

import { SPEEDS } from "./playback";
import type { Mode, Orbit } from "./scene/camera";

export interface Place {
  episodes: string[];
  t: number;
  speed: number;
  mode: Mode;
  agent: string;
  focus: number;
  isInStep: boolean;
  orbit: Orbit | null;
}

const FARTHEST = 1e6;
const MODES: readonly string[] = ["top", "follow", "free"];
const MOST = 9;

/** Writes a fragment; without a time the link plays from the beginning. */
export function formatLink(place: Omit<Place, "t"> & { t: number | null }): string {
  const parts = new URLSearchParams();
  if (place.episodes.length) parts.set("e", place.episodes.join(","));
  if (place.t !== null) parts.set("t", place.t.toFixed(1));
  if (place.speed !== 1) parts.set("speed", String(place.speed));
  parts.set("cam", place.mode);
  if (place.agent) parts.set("agent", place.agent);
  if (place.focus) parts.set("focus", String(place.focus));
  if (!place.isInStep) parts.set("clock", "own");
  if (place.orbit) {
    const { x, y, distance, azimuth, tilt } = place.orbit;
    parts.set(
      "at",
      [x.toFixed(1), y.toFixed(1), distance.toFixed(1), azimuth.toFixed(3), tilt.toFixed(3)].join(","),
    );
  }
  return `#${parts.toString().replaceAll("%2C", ",")}`;
}

const finite = (text: string | null, otherwise: number): number => {
  const value = text === null || text === "" ? NaN : Number(text);
  return Number.isFinite(value) ? value : otherwise;
};

export function parseLink(fragment: string): Place {
  const parts = new URLSearchParams(fragment.replace(/^#/, ""));
  const mode = parts.get("cam") ?? "top";
  const at = (parts.get("at") ?? "").split(",").map((text) => finite(text, NaN));
  const isPlace = at.length === 5 && at.every((each) => Math.abs(each) <= FARTHEST) && at[2] > 0;
  return {
    episodes: (parts.get("e") ?? "").split(",").filter(Boolean).slice(0, MOST),
    t: Math.max(0, finite(parts.get("t"), 0)),
    speed: SPEEDS.find((speed) => speed === Number(parts.get("speed"))) ?? 1,
    mode: (MODES.includes(mode) ? mode : "top") as Mode,
    agent: parts.get("agent") ?? "",
    focus: Math.max(0, Math.min(MOST - 1, Math.floor(finite(parts.get("focus"), 0)))),
    isInStep: parts.get("clock") !== "own",
    orbit: isPlace
      ? {
          x: at[0],
          y: at[1],
          distance: Math.min(5000, Math.max(9, at[2])),
          azimuth: at[3],
          tilt: Math.min(1.42, Math.max(0, at[4])),
        }
      : null,
  };
}
