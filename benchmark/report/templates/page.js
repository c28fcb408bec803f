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
// The series under the pointer or with the focus stands out in all plots.
function choose(label) {
  document.body.classList.toggle("chosen", label !== undefined);
  document.querySelectorAll("[data-series]").forEach((each) => each.classList.toggle("is-chosen", each.dataset.series === label));
}
document.querySelectorAll(".legend [data-series]").forEach((each) => {
  for (const begin of ["pointerenter", "focus"]) each.addEventListener(begin, () => choose(each.dataset.series));
  for (const end of ["pointerleave", "blur"]) each.addEventListener(end, () => choose());
});
document.querySelectorAll(".copy").forEach((button) => button.addEventListener("click", async () => {
  await navigator.clipboard.writeText(button.previousElementSibling.textContent);
  button.textContent = "Copied";
}));
// A link into what is folded opens it.
const unfold = () => document.getElementById(location.hash.slice(1))?.closest("details")?.setAttribute("open", "");
addEventListener("hashchange", unfold);
unfold();
// The viewer is a page of its own inside this one; it loads when it comes into sight.
const player = document.querySelector("#player");
if (player) {
  const bytes = Uint8Array.from(atob(document.querySelector("#viewer").textContent), (sign) => sign.charCodeAt(0));
  const address = URL.createObjectURL(new Blob([bytes], { type: "text/html" }));
  const tabs = [...document.querySelectorAll("[data-episode]")];
  const play = (chosen) => {
    tabs.forEach((tab) => tab.setAttribute("aria-pressed", tab === chosen));
    player.src = `${address}#e=${chosen.dataset.episode}`;
  };
  tabs.forEach((tab) => tab.addEventListener("click", () => play(tab)));
  const sight = new IntersectionObserver(([entry]) => {
    if (entry.isIntersecting) { sight.disconnect(); play(tabs[0]); }
  });
  sight.observe(player);
}
