/** Elements from values; texts are set as text, never parsed. */

type Child = Node | string | null | false;
type Properties = Record<string, string | number | boolean | ((event: never) => void) | undefined>;
const SVG = "http://www.w3.org/2000/svg";

function apply(element: Element, properties: Properties): void {
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === false) continue;
    if (typeof value === "function")
      element.addEventListener(name.slice(2).toLowerCase(), value as EventListener);
    else if (name === "class") element.setAttribute("class", String(value));
    else element.setAttribute(name, value === true ? "" : String(value));
  }
}

export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  apply(element, properties);
  element.append(...children.filter((child): child is Node | string => child !== null && child !== false));
  return element;
}

export function svg<K extends keyof SVGElementTagNameMap>(
  tag: K,
  properties: Properties = {},
  ...children: Node[]
): SVGElementTagNameMap[K] {
  const element = document.createElementNS(SVG, tag);
  apply(element, properties);
  element.append(...children);
  return element;
}

const ICONS: Record<string, string> = {
  play: "M8 5.5v13l11-6.5z",
  pause: "M7 5h3.6v14H7zM13.4 5H17v14h-3.6z",
  back: "M18 6v12l-8.5-6zM6 6h2.2v12H6z",
  forward: "M6 6v12l8.5-6zM15.8 6H18v12h-2.2z",
  before: "M12.5 6v12L4 12zM20.5 6v12L12 12z",
  after: "M11.5 6v12l8.5-6zM3.5 6v12l8.5-6z",
  list: "M4 6h16v2H4zM4 11h16v2H4zM4 16h16v2H4z",
  theme: "M12 3a9 9 0 1 0 9 9c0-.5 0-.9-.1-1.4A5.5 5.5 0 0 1 13.400 3.100 9 9 0 0 0 12 3z",
  link: "M10.600 13.400a1 1 0 0 0 1.400 0l5-5a1.500 1.500 0 0 1 2.100 2.100l-3 3 1.400 1.400 3-3a3.500 3.500 0 0 0-5-5l-5 5a1 1 0 0 0 .1 1.500zM13.400 10.600a1 1 0 0 0-1.400 0l-5 5A1.500 1.500 0 0 1 4.900 13.500l3-3-1.400-1.400-3 3a3.500 3.500 0 0 0 5 5l5-5a1 1 0 0 0-.1-1.500z",
  close:
    "M6.400 5 12 10.600 17.600 5 19 6.400 13.400 12 19 17.600 17.600 19 12 13.400 6.400 19 5 17.600 10.600 12 5 6.400z",
  help: "M11 16.500h2v2.200h-2zM12 5a4 4 0 0 0-4 4h2a2 2 0 1 1 3.300 1.500C12 11.600 11 12.400 11 15h2c0-1.600.6-2.200 1.600-3.100A4 4 0 0 0 12 5z",
  expand: "M5 5h6v2H7v4H5zM13 17h4v-4h2v6h-6zM13 5h6v6h-2V7h-4zM5 13h2v4h4v2H5z",
  fit: "M12 8.500a3.500 3.500 0 1 0 0 7 3.500 3.500 0 0 0 0-7zM11 3h2v3.500h-2zM11 17.500h2V21h-2zM3 11h3.500v2H3zM17.500 11H21v2h-3.500z",
  panel: "M4 5h16v14H4zM6 7v10h7V7zM15 7v10h3V7z",
};

export function icon(name: string): SVGSVGElement {
  return svg(
    "svg",
    { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true" },
    svg("path", { d: ICONS[name] ?? "", "fill-rule": "evenodd" }),
  );
}

/** A button with an icon; `label` is read aloud and shown as a hint, `key` beside it. */
export function iconButton(name: string, label: string, onClick: () => void, key = ""): HTMLButtonElement {
  return h(
    "button",
    {
      class: "icon-button",
      type: "button",
      title: key ? `${label} (${key})` : label,
      "aria-label": label,
      onClick,
    },
    icon(name),
  );
}

export function setIcon(button: HTMLElement, name: string, label: string): void {
  if (button.getAttribute("aria-label") === label) return;
  button.replaceChildren(icon(name));
  button.setAttribute("aria-label", label);
  button.title = label;
}

export const seconds = (t: number): string => {
  const whole = Math.max(0, t);
  return whole < 60
    ? whole.toFixed(1)
    : `${Math.floor(whole / 60)}:${(whole % 60).toFixed(1).padStart(4, "0")}`;
};
