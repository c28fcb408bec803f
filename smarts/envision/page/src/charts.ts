/** Small line charts over time, with a cursor. */

import type { Series } from "./agents";
import { h, svg } from "./dom";

const WIDTH = 300;
/** Lines in one chart. */
const MOST = 6;

interface Scale {
  begin: number;
  end: number;
  low: number;
  high: number;
}

export class Chart {
  readonly element: HTMLElement;
  private readonly plot: SVGSVGElement;
  private readonly cursor = svg("line", { class: "cursor", y1: 0 });
  private readonly value = h("span", { class: "value" });
  /** The names of several lines, with their values. */
  private readonly keys = h("div", { class: "keys" });
  private scale: Scale = { begin: 0, end: 1, low: 0, high: 1 };
  private series: readonly Series[] = [];

  constructor(
    private readonly title: string,
    private readonly unit: string,
    private readonly height: number,
    onSeek: (step: number) => void,
  ) {
    this.plot = svg("svg", {
      viewBox: `0 0 ${WIDTH} ${height}`,
      preserveAspectRatio: "none",
      role: "img",
      "aria-label": `${title} over time`,
    });
    this.cursor.setAttribute("y2", String(height));
    this.plot.addEventListener("click", (event) => {
      const box = this.plot.getBoundingClientRect();
      onSeek(
        this.scale.begin + ((event.clientX - box.left) / box.width) * (this.scale.end - this.scale.begin),
      );
    });
    this.element = h(
      "figure",
      { class: "chart" },
      h("figcaption", {}, h("span", { class: "name" }, title), this.value),
      this.plot,
      this.keys,
    );
  }

  /** Draws lines over the steps from `begin` to `end`. */
  show(series: readonly Series[], begin: number, end: number): void {
    this.series = series;
    const shown = series.length > 1 ? series.slice(0, MOST) : [];
    this.keys.replaceChildren(...shown.map((_, i) => h("span", { class: `key key-${i}` })));
    this.keys.hidden = !shown.length;
    const values = series.flatMap((each) => each.values).filter(Number.isFinite);
    const low = Math.min(0, ...values.slice(0, 50_000));
    const high = Math.max(low + 1e-3, ...values.slice(0, 50_000));
    this.scale = { begin, end: Math.max(begin + 1, end), low, high };
    const zero = this.y(0);
    const lines = series
      .slice(0, MOST)
      .map((each, i) => svg("path", { d: this.path(each), class: `line line-${i}` }));
    const area = series.length === 1 ? [svg("path", { d: this.area(series[0], zero), class: "area" })] : [];
    this.plot.replaceChildren(
      svg("line", { class: "axis", x1: 0, x2: WIDTH, y1: zero, y2: zero }),
      ...area,
      ...lines,
      this.cursor,
    );
  }

  update(step: number): void {
    const x = ((step - this.scale.begin) / (this.scale.end - this.scale.begin)) * WIDTH;
    this.cursor.setAttribute("x1", x.toFixed(1));
    this.cursor.setAttribute("x2", x.toFixed(1));
    const texts = this.series.slice(0, MOST).map((each) => {
      const value = format(at(each, step));
      return this.series.length > 1 ? `${each.name.replace(/^reward\//, "")} ${value}` : `${value} ${this.unit}`;
    });
    const places = this.series.length > 1 ? [...this.keys.children] : [this.value];
    places.forEach((place, i) => {
      if (place.textContent !== texts[i]) place.textContent = texts[i];
    });
    this.plot.setAttribute("aria-label", `${this.title} over time: ${texts.join(", ")}`);
  }

  private x(step: number): number {
    return ((step - this.scale.begin) / (this.scale.end - this.scale.begin)) * WIDTH;
  }

  private y(value: number): number {
    const { low, high } = this.scale;
    return 2 + (1 - (value - low) / (high - low)) * (this.height - 4);
  }

  private path({ steps, values }: Series): string {
    const stride = Math.max(1, Math.floor(values.length / 600));
    const points: string[] = [];
    for (let i = 0; i < values.length; i += stride)
      if (Number.isFinite(values[i]))
        points.push(`${this.x(steps[i]).toFixed(1)} ${this.y(values[i]).toFixed(1)}`);
    return points.length ? `M${points.join("L")}` : "";
  }

  private area(series: Series, zero: number): string {
    const path = this.path(series);
    if (!path) return "";
    const { steps } = series;
    return `${path}L${this.x(steps[steps.length - 1]).toFixed(1)} ${zero.toFixed(1)}L${this.x(steps[0]).toFixed(1)} ${zero.toFixed(1)}Z`;
  }
}

const format = (value: number): string =>
  Number.isFinite(value) ? value.toFixed(Math.abs(value) < 10 ? 2 : 1) : "–";

function at({ steps, values }: Series, step: number): number {
  let low = 0;
  let high = steps.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (steps[middle] <= step + 1e-6) low = middle + 1;
    else high = middle;
  }
  return low ? values[low - 1] : NaN;
}
