/** What the browser keeps of the page's settings. */

export function storedTheme(): "dark" | "light" {
  try {
    const kept = localStorage.getItem("theme");
    if (kept === "dark" || kept === "light") return kept;
  } catch {
    // Pages from files may have no storage.
  }
  return matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark";
}

export function keep(name: string, value: string): void {
  try {
    localStorage.setItem(name, value);
  } catch {
    // Pages from files may have no storage.
  }
}
