/** One canvas for all views: places them in a grid, draws them, and turns pointers into camera moves. */

import { ColorManagement, LinearSRGBColorSpace, WebGLRenderer } from "three";
import { h, iconButton } from "./dom";
import { gridOf } from "./places";
import type { Theme } from "./scene/palette";
import type { View } from "./view";

ColorManagement.enabled = false;

const SLOW = 1 / 45;
const FAST = 1 / 55;
const PATIENCE = 24;
const TRUST = 180;
const COARSEST = 0.5;
const CLICK = 6;
/** Metres of a pixel up to which all egos show their names. */
const CLOSE = 0.14;

/** Of the names beside vehicles [pixels]. */
const LABEL_WIDTH = 220;
const LABEL_HEIGHT = 20;
const LABEL_MARGIN = 16;
const LETTER_WIDTH = 6.6;
const LABEL_RISE = 14;

const within = (value: number, low: number, high: number): number =>
  Math.max(low, Math.min(Math.max(low, high), value));

interface Cell {
  view: View;
  element: HTMLElement;
  status: HTMLElement;
  labels: HTMLElement;
  /** Its place on the canvas, from the lower left, and its size. */
  box: { x: number; y: number; width: number; height: number };
}

/** The name of what draws; null where nothing does. */
function graphics(): string | null {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return null;
  const name = gl.getExtension("WEBGL_debug_renderer_info");
  const renderer = name ? String(gl.getParameter(name.UNMASKED_RENDERER_WEBGL)) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return renderer;
}

const NO_WEBGL = "This browser draws no 3D pictures: WebGL is switched off, or the graphics driver is blocked.";

function rendererOf(): WebGLRenderer | null {
  const name = graphics();
  if (name === null) return null;
  // Without a graphics processor smooth edges cost too much.
  const antialias = !/swiftshader|llvmpipe|software/i.test(name);
  try {
    const renderer = new WebGLRenderer({ antialias, powerPreference: "high-performance" });
    renderer.outputColorSpace = LinearSRGBColorSpace;
    renderer.setScissorTest(true);
    renderer.domElement.setAttribute("aria-hidden", "true");
    return renderer;
  } catch {
    return null;
  }
}

export class Stage {
  readonly element = h("main", { class: "stage", "aria-label": "scene" });
  onFocus: (index: number) => void = () => {};
  onPick: (view: View, place: number) => void = () => {};
  onExpand: (index: number) => void = () => {};
  private readonly renderer: WebGLRenderer | null;
  private readonly grid = h("div", { class: "grid" });
  /** Why there is nothing to see. */
  private readonly notice = h("p", { class: "no-picture", role: "alert", hidden: true });
  private cells: Cell[] = [];
  private ratio = 1;
  private slow = 0;
  private fast = 0;
  private isResized = true;
  private readonly pointers = new Map<number, { x: number; y: number }>();
  private pressed: { cell: Cell; x: number; y: number; moved: number } | null = null;

  constructor() {
    this.renderer = rendererOf();
    if (this.renderer) this.element.append(this.renderer.domElement, this.grid);
    else this.element.append(h("p", { class: "no-picture", role: "alert" }, NO_WEBGL));
    this.element.append(this.notice);
    // Graphics drivers that start again have lost all, which is made again with the next picture.
    this.renderer?.domElement.addEventListener("webglcontextrestored", () => (this.isResized = true));
    new ResizeObserver(() => (this.isResized = true)).observe(this.element);
    this.listen();
  }

  /** Shows these views. */
  show(views: readonly View[]): void {
    this.cells = views.map((view, index) => this.cell(view, index, views.length > 1));
    this.grid.replaceChildren(...this.cells.map((cell) => cell.element));
    this.isResized = true;
    if (views.length) this.setNotice("");
  }

  /** Shows a text in place of views. */
  setNotice(text: string): void {
    this.notice.textContent = text;
    this.notice.hidden = !text;
  }

  setFocus(index: number): void {
    this.cells.forEach((cell, i) =>
      cell.element.toggleAttribute("data-focus", i === index && this.cells.length > 1),
    );
  }

  setStatus(index: number, text: string, tone: string): void {
    const status = this.cells[index]?.status;
    if (!status || (status.textContent === text && status.dataset.tone === tone)) return;
    status.textContent = text;
    status.dataset.tone = tone;
  }

  private cell(view: View, index: number, isOneOfMany: boolean): Cell {
    const status = h("span", { class: "badge" });
    const labels = h("div", { class: "labels", "aria-hidden": "true" });
    const name = h(
      "button",
      { class: "cell-name", type: "button", onClick: () => this.onFocus(index) },
      view.title,
    );
    const expand = iconButton("expand", `Show only ${view.title}`, () => this.onExpand(index));
    const head = h("div", { class: "cell-head" }, name, status, expand);
    const element = h("section", { class: "cell", "aria-label": view.title }, labels, isOneOfMany && head);
    return { view, element, status, labels, box: { x: 0, y: 0, width: 1, height: 1 } };
  }

  private layOut(): void {
    const { clientWidth: width, clientHeight: height } = this.element;
    const [columns, rows] = gridOf(Math.max(1, this.cells.length), height > width);
    this.grid.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    this.grid.style.gridTemplateRows = `repeat(${rows}, minmax(0, 1fr))`;
    this.renderer?.setPixelRatio(Math.min(2, devicePixelRatio) * this.ratio);
    this.renderer?.setSize(width, height);
    // Sizes are read here alone: to ask for them in each picture makes the browser lay out the page.
    const whole = this.element.getBoundingClientRect();
    for (const cell of this.cells) {
      const box = cell.element.getBoundingClientRect();
      const [x, y] = [box.left - whole.left, whole.bottom - box.bottom];
      cell.box = { x, y, width: box.width, height: box.height };
      cell.view.rig.resize(box.width, box.height);
    }
    this.isResized = false;
  }

  /** Draws all views; returns at once where nothing has changed. */
  draw(seconds: number, theme: Theme, isForced: boolean): boolean {
    const isFresh =
      isForced || this.isResized || this.cells.some(({ view }) => view.isDirty || view.rig.isMoving);
    const { renderer } = this;
    if (!isFresh || !renderer) return false;
    if (this.isResized) this.layOut();
    this.adapt(seconds);
    renderer.setClearColor(0, 1);
    for (const cell of this.cells) {
      const { x, y, width, height } = cell.box;
      renderer.setViewport(x, y, width, height);
      renderer.setScissor(x, y, width, height);
      cell.view.update(seconds, theme);
      renderer.render(cell.view.scene, cell.view.rig.camera);
      this.label(cell);
    }
    return true;
  }

  /** Lowers the resolution while pictures come too slowly, and raises it when they come fast for long. */
  private adapt(seconds: number): void {
    this.slow = seconds > SLOW ? this.slow + 1 : Math.max(0, this.slow - 2);
    this.fast = seconds < FAST ? this.fast + 1 : 0;
    const isLowered = this.slow >= PATIENCE && this.ratio > COARSEST;
    const isRaised = this.fast >= TRUST && this.ratio < 1;
    if (!isLowered && !isRaised) return;
    this.slow = this.fast = 0;
    this.ratio = isLowered ? Math.max(COARSEST, this.ratio * 0.8) : Math.min(1, this.ratio * 1.25);
    this.layOut();
  }

  /** Writes the names of agents beside their vehicles. */
  private label({ view, labels, box: { width, height } }: Cell): void {
    const { now, rig } = view;
    let used = 0;
    const isNear = rig.pixel * rig.aim.distance < CLOSE;
    for (let i = 0; i < now.count && this.cells.length < 5; i++) {
      const agent = view.agents[now.agent[i]];
      if (!agent || !(agent === view.chosen || (agent.isEgo && isNear))) continue;
      const at = rig.camera.position.clone().set(now.x[i], now.y[i], 2).project(rig.camera);
      if (Math.abs(at.x) > 1 || Math.abs(at.y) > 1 || at.z > 1) continue;
      const label =
        (labels.children[used] as HTMLElement | undefined) ??
        labels.appendChild(h("span", { class: "label" }));
      used++;
      if (label.textContent !== agent.name) label.textContent = agent.name;
      label.toggleAttribute("data-chosen", agent === view.chosen);
      // Its width is reckoned: to ask for it makes the browser lay out the page.
      const half = Math.min(LABEL_WIDTH, LABEL_MARGIN + LETTER_WIDTH * agent.name.length) / 2;
      const x = within(((at.x + 1) / 2) * width, half, width - half);
      const y = within(((1 - at.y) / 2) * height - LABEL_RISE, LABEL_HEIGHT, height);
      label.style.transform = `translate(${x}px, ${y}px) translate(-50%, -100%)`;
    }
    while (labels.children.length > used) labels.lastChild!.remove();
  }

  /** The cell under a pointer, and the place in it, 0 to 1 from the upper left. */
  private under(event: {
    clientX: number;
    clientY: number;
  }): { cell: Cell; index: number; u: number; v: number } | null {
    for (const [index, cell] of this.cells.entries()) {
      const box = cell.element.getBoundingClientRect();
      const [u, v] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
      if (u >= 0 && u <= 1 && v >= 0 && v <= 1) return { cell, index, u, v };
    }
    return null;
  }

  private listen(): void {
    const { grid } = this;
    grid.addEventListener("contextmenu", (event) => event.preventDefault());
    grid.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        const found = this.under(event);
        if (!found) return;
        found.cell.view.rig.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.003));
        found.cell.view.isDirty = true;
      },
      { passive: false },
    );
    grid.addEventListener("pointerdown", (event) => this.press(event));
    grid.addEventListener("pointermove", (event) => this.drag(event));
    for (const name of ["pointerup", "pointercancel"] as const)
      grid.addEventListener(name, (event) => this.release(event, name === "pointerup"));
    grid.addEventListener("dblclick", (event) => {
      const found = this.under(event);
      if (found && this.cells.length > 1) this.onExpand(found.index);
    });
  }

  private press(event: PointerEvent): void {
    if ((event.target as Element).closest("button")) return;
    const found = this.under(event);
    if (!found) return;
    this.grid.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (this.pointers.size === 1)
      this.pressed = { cell: found.cell, x: event.clientX, y: event.clientY, moved: 0 };
    if (this.cells.length > 1 && !found.cell.element.hasAttribute("data-focus")) this.onFocus(found.index);
  }

  private drag(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (!before || !this.pressed) return;
    const { rig } = this.pressed.cell.view;
    const after = { x: event.clientX, y: event.clientY };
    const [dx, dy] = [after.x - before.x, after.y - before.y];
    this.pressed.moved += Math.hypot(dx, dy);
    this.pressed.cell.view.isDirty = true;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, after);
    if (other) {
      const [was, is] = [
        Math.hypot(before.x - other.x, before.y - other.y),
        Math.hypot(after.x - other.x, after.y - other.y),
      ];
      if (was > 10 && is > 10) rig.zoom(was / is);
      const turned =
        Math.atan2(after.y - other.y, after.x - other.x) - Math.atan2(before.y - other.y, before.x - other.x);
      if (rig.mode !== "top") rig.twist(Math.atan2(Math.sin(turned), Math.cos(turned)));
      rig.pan(dx / 2, rig.mode === "follow" ? 0 : dy / 2);
    } else if (event.buttons & 2 || event.shiftKey) rig.rotate(dx, dy);
    else rig.pan(dx, dy);
  }

  private release(event: PointerEvent, isUp: boolean): void {
    this.pointers.delete(event.pointerId);
    if (this.pointers.size) return;
    const { pressed } = this;
    this.pressed = null;
    if (!pressed || !isUp || pressed.moved > CLICK) return;
    const found = this.under(event);
    const point = found?.cell.view.rig.ground(found.u, found.v);
    if (!found || !point) return;
    const place = found.cell.view.pick(point.x, point.y);
    if (place >= 0) this.onPick(found.cell.view, place);
  }
}
