/** What the chosen agent observes, in the panel: pictures of grids, and numbers. */

import { h } from "./dom";
import { type Grid, type Observed, pixelsOf } from "./observed";

const MOST_NUMBERS = 24;
const MOST_ROWS = 24;
const COLOUR = [0.93, 0.95, 0.97];

export class SightPanel {
  readonly element = h("section", { class: "sight", "aria-label": "observation", hidden: true });
  private shown = "";

  /** Shows an observation; where there is none, nothing. */
  show(observed: Observed | null): void {
    const key = observed?.key ?? "";
    if (key === this.shown) return;
    this.shown = key;
    this.element.hidden = observed === null;
    if (!observed) return;
    const counts = [
      [observed.waypoints.length, "path", "paths of waypoints"],
      [observed.neighbors.length, "neighbour", "neighbours"],
      [observed.lidar.length >> 1, "lidar point", "lidar points"],
    ] as const;
    const text = counts.flatMap(([count, one, many]) => (count ? [`${count} ${count > 1 ? many : one}`] : []));
    this.element.replaceChildren(
      h("h3", {}, "observes"),
      h("p", { class: "small" }, text.join(", ")),
      h("div", { class: "grids" }, ...observed.grids.map(picture)),
      ...observed.others.slice(0, MOST_ROWS).map(([name, values]) => numbersRow(name, values)),
    );
  }
}

function picture(grid: Grid): HTMLElement {
  const canvas = h("canvas", {
    width: grid.width,
    height: grid.height,
    role: "img",
    "aria-label": `${grid.name}, ${grid.height} x ${grid.width} cells of ${grid.size} m`,
  });
  const pixels = new Uint8ClampedArray(pixelsOf(grid, COLOUR, 1).buffer);
  canvas.getContext("2d")?.putImageData(new ImageData(pixels, grid.width, grid.height), 0, 0);
  return h("figure", {}, canvas, h("figcaption", { class: "small" }, grid.name.replaceAll("_", " ")));
}

function numbersRow(name: string, values: ArrayLike<number>): HTMLElement {
  const shown = Array.from(values).slice(0, MOST_NUMBERS);
  const more = values.length > MOST_NUMBERS ? ` and ${values.length - MOST_NUMBERS} more` : "";
  const text = shown.map((value) => (Number.isInteger(value) ? String(value) : value.toFixed(2))).join(" ");
  return h("p", { class: "numbers" }, h("b", {}, name.replaceAll("_", " ")), ` ${text}${more}`);
}
