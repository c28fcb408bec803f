// Sorts the rows of each body of a table by the column whose title was pressed, and hides what filters leave out.
function sortBy(button) {
  const head = button.closest("th");
  const table = head.closest("table");
  const column = Number(head.dataset.column);
  const rising = head.getAttribute("aria-sort") !== "ascending";
  table.querySelectorAll("th[aria-sort]").forEach((other) => other.removeAttribute("aria-sort"));
  head.setAttribute("aria-sort", rising ? "ascending" : "descending");
  for (const body of table.tBodies) {
    const rows = [...body.rows];
    const keys = rows.map(({ cells }) => sortKey(cells[column].dataset.value ?? cells[column].textContent.trim()));
    sortedRows(keys, rising).forEach((number) => body.append(rows[number]));
  }
}
function filter(box) {
  const chosen = Object.fromEntries([...box.querySelectorAll("select")].map((select) => [select.name, select.value]));
  document.querySelectorAll(box.dataset.of).forEach((row) => {
    row.hidden = !isShown(row.dataset, chosen);
  });
}
document.querySelectorAll("button.sort").forEach((button) => button.addEventListener("click", () => sortBy(button)));
document.querySelectorAll(".filters").forEach((box) => {
  box.addEventListener("change", () => filter(box));
  filter(box);
});
