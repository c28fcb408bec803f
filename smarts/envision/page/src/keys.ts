/** Keys and what they do. */

/** What is shown, the action, and its description. */
export const KEYS: readonly [string, string, string][] = [
  ["space", "toggle", "play or pause"],
  ["← →", "", "5 s back, forward"],
  [", .", "", "one step back, forward"],
  ["[ ]", "", "event before, next event"],
  ["− +", "", "slower, faster"],
  ["1 2 3", "", "camera: top, follow, free"],
  ["0", "fit", "show where agents drive"],
  ["a", "agent", "next agent (shift: before)"],
  ["c", "cell", "next view of the grid"],
  ["s", "inStep", "views in step, or each by itself"],
  ["e", "list", "episodes"],
  ["p", "panel", "panel of the agent"],
  ["t", "theme", "dark or light"],
  ["l", "link", "copy the link to this view"],
  ["z x", "", "closer, farther"],
  ["?", "help", "keys"],
];

const ACTIONS: Record<string, string> = {
  " ": "toggle",
  k: "toggle",
  ArrowLeft: "back",
  ArrowRight: "forward",
  ",": "before",
  ".": "after",
  "[": "previous",
  "]": "next",
  Home: "begin",
  End: "end",
  "-": "slower",
  "+": "faster",
  "=": "faster",
  "1": "top",
  "2": "follow",
  "3": "free",
  "0": "fit",
  a: "agent",
  A: "agent",
  c: "cell",
  s: "inStep",
  e: "list",
  p: "panel",
  t: "theme",
  l: "link",
  "?": "help",
  z: "closer",
  x: "farther",
};

/** The action of a key; null where the element with the focus uses the key itself. */
export function keyAction(event: KeyboardEvent): string | null {
  const target = event.target as HTMLElement | null;
  if (target?.closest("input, select, textarea, dialog")) return null;
  if (event.key === " " && target?.closest("button")) return null;
  return ACTIONS[event.key] ?? null;
}
