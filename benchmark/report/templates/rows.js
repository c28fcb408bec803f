"use strict";
// What tables of a page show in which order, without the page itself: tests/unit/benchmark/test_page_script.py.

// Returns what a cell is sorted by: a number, else its text, null for nothing.
function sortKey(text) {
  const number = Number(text);
  return text === "" ? null : Number.isNaN(number) ? text : number;
}
// Returns the numbers of rows in the order of their keys, numbers before texts. What is equal stays as it was, and
// nothing goes last whichever way.
function sortedRows(keys, rising) {
  const isText = (key) => typeof key === "string";
  const compare = (a, b) => {
    if (isText(a) !== isText(b)) return isText(a) - isText(b);
    return isText(a) ? a.localeCompare(b, "en", { numeric: true }) : a - b;
  };
  const order = (a, b) => {
    if (a === null || b === null) return (a === null) - (b === null);
    return rising ? compare(a, b) : compare(b, a);
  };
  return [...keys.keys()].sort((a, b) => order(keys[a], keys[b]) || a - b);
}
// Tells whether a row fits all that is chosen, name by name; "" chooses all, and what a row does not have fits.
function isShown(row, chosen) {
  return Object.entries(chosen).every(([name, value]) => value === "" || (row[name] ?? value) === value);
}
