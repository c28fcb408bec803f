"use strict";
// Sorts the rows of each body of a table by the column whose title was pressed; cells without a number go last.
function key(row, column) {
  const cell = row.cells[column];
  const text = cell.dataset.value ?? cell.textContent.trim();
  const number = Number(text);
  return text === "" ? null : Number.isNaN(number) ? text : number;
}
function compare(a, b) {
  if (typeof a === "number" && typeof b === "number") return a - b;
  return String(a).localeCompare(String(b), "en", { numeric: true });
}
function sortBy(button) {
  const head = button.closest("th");
  const table = head.closest("table");
  const column = Number(head.dataset.column);
  const rising = head.getAttribute("aria-sort") !== "ascending";
  table.querySelectorAll("th[aria-sort]").forEach((other) => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", rising ? "ascending" : "descending");
  for (const body of table.tBodies) {
    const rows = [...body.rows].map((row, place) => ({ row, place, key: key(row, column) }));
    rows.sort((a, b) => {
      if (a.key === null || b.key === null) return (a.key === null) - (b.key === null) || a.place - b.place;
      return (rising ? 1 : -1) * compare(a.key, b.key) || a.place - b.place;
    });
    rows.forEach(({ row }) => body.append(row));
  }
}
function filter(box) {
  const wanted = [...box.querySelectorAll("select")].filter((select) => select.value !== "");
  document.querySelectorAll(box.dataset.of).forEach((row) => {
    row.hidden = !wanted.every((select) => (row.dataset[select.name] ?? select.value) === select.value);
  });
}
document.querySelectorAll("button.sort").forEach((button) => button.addEventListener("click", () => sortBy(button)));
document.querySelectorAll(".filters").forEach((box) => {
  box.addEventListener("change", () => filter(box));
  filter(box);
});
