/** What an agent observes, where the recording has it. No DOM. */

import type { Agent } from "./agents";
import type { Recording } from "./episode";
import type { Numbers } from "./messages";

/** Rows hold until the next one of the same name, this long at most [s]. */
const HOLDS = 1;
/** The same live, where a simulation may run at many times real time. */
const HOLDS_LIVE = 5;
const NEIGHBOR = 6;
const HEAD = 3;
const MOST_CELLS = 1 << 20;

export interface Neighbor {
  x: number;
  y: number;
  heading: number;
  length: number;
  width: number;
  speed: number;
}

/** Cells about the vehicle as it was at the step, turned with it: row by row, the farthest ahead first, each from left to right. */
export interface Grid {
  name: string;
  step: number;
  height: number;
  width: number;
  /** Of a cell [m]. */
  size: number;
  /** Of a cell: 1, or 3 of colours; from 0 to 1. */
  channels: 1 | 3;
  values: Numbers;
}

export interface Observed {
  /** Changes with what is observed. */
  key: string;
  /** Of each path x, y in turn [m]. */
  waypoints: Numbers[];
  neighbors: Neighbor[];
  /** x, y in turn [m]. */
  lidar: Numbers;
  grids: Grid[];
  /** Other observations, by name. */
  others: [string, Numbers][];
}

const NONE = new Float32Array(0);

/** Returns what the agent observed last at a step; null where nothing is recorded. */
export function observedBy(recording: Recording, agent: Agent, step: number): Observed | null {
  const table = recording.table("observations");
  if (!table.rows) return null;
  const [steps, names] = [table.numbers("step"), table.texts("name")];
  const rows = recording.index("observations", "agent").upTo(agent.row, step);
  const oldest = step - (recording.isLive ? HOLDS_LIVE : HOLDS) / recording.dt;
  const found = new Map<string, number>();
  for (let i = rows.length - 1; i >= 0 && steps[rows[i]] >= oldest; i--)
    if (!found.has(names[rows[i]])) found.set(names[rows[i]], rows[i]);
  if (!found.size) return null;
  const observed: Observed = {
    key: `${agent.row} ${[...found.values()].join(" ")}`,
    waypoints: [],
    neighbors: [],
    lidar: NONE,
    grids: [],
    others: [],
  };
  for (const [name, row] of found) take(observed, name ?? "", steps[row], table.list("values", row));
  observed.grids.sort((a, b) => a.name.localeCompare(b.name));
  observed.others.sort(([a], [b]) => a.localeCompare(b));
  return observed;
}

function take(observed: Observed, name: string, step: number, values: Numbers): void {
  if (name === "waypoints") observed.waypoints = pathsOf(values);
  else if (name === "neighbors") observed.neighbors = neighborsOf(values);
  else if (name === "lidar") observed.lidar = values.subarray(0, values.length & ~1);
  else if (name.startsWith("grid:") || name.startsWith("rgb:")) {
    const grid = gridOf(name, step, values);
    if (grid) observed.grids.push(grid);
  } else observed.others.push([name, values]);
}

/** Parts paths at pairs that are not numbers. */
function pathsOf(values: Numbers): Numbers[] {
  const paths: Numbers[] = [];
  let begin = 0;
  for (let at = 0; at + 1 < values.length + 2; at += 2) {
    const isPoint = at + 1 < values.length && Number.isFinite(values[at]) && Number.isFinite(values[at + 1]);
    if (isPoint) continue;
    if (at > begin) paths.push(values.subarray(begin, Math.min(at, values.length & ~1)));
    begin = at + 2;
  }
  return paths;
}

function neighborsOf(values: Numbers): Neighbor[] {
  const neighbors: Neighbor[] = [];
  for (let at = 0; at + NEIGHBOR <= values.length; at += NEIGHBOR) {
    const [x, y, heading, length, width, speed] = values.subarray(at, at + NEIGHBOR);
    if ([x, y, heading].every(Number.isFinite)) neighbors.push({ x, y, heading, length, width, speed });
  }
  return neighbors;
}

function gridOf(name: string, step: number, values: Numbers): Grid | null {
  const [height, width, size] = values;
  const channels = name.startsWith("rgb:") ? 3 : 1;
  const cells = height * width;
  const isWhole = Number.isInteger(height) && Number.isInteger(width) && height > 0 && width > 0;
  if (!isWhole || cells > MOST_CELLS || !(size > 0) || values.length !== HEAD + channels * cells) return null;
  const cellValues = values.subarray(HEAD);
  return { name: name.slice(name.indexOf(":") + 1), step, height, width, size, channels, values: cellValues };
}

/** The grid that lies on the ground, where there are several. */
const ON_GROUND = "occupancy";

/** Returns the grid that lies on the ground, if there is one. */
export function groundOf(observed: Observed | null): Grid | undefined {
  const grids = observed?.grids ?? [];
  return grids.find(({ name }) => name === ON_GROUND) ?? grids[0];
}

/** Returns a grid as bytes of red, green, blue and alpha; `colour` is that of full cells. */
export function pixelsOf(grid: Grid, colour: readonly number[], alpha: number): Uint8Array<ArrayBuffer> {
  const { channels, values } = grid;
  const cells = grid.height * grid.width;
  const pixels = new Uint8Array(4 * cells);
  const byte = (value: number) => Math.round(255 * Math.min(1, Math.max(0, value)));
  for (let i = 0; i < cells; i++) {
    const isColoured = channels === 3;
    for (let c = 0; c < 3; c++) pixels[4 * i + c] = byte(isColoured ? values[3 * i + c] : colour[c]);
    pixels[4 * i + 3] = byte(alpha * (isColoured ? 1 : values[i]));
  }
  return pixels;
}
