/** Tables of a recorded episode: columns by name, rows that live streams append. No DOM. */

import type { Column, Columns, Lists, Numbers } from "./messages";

const NONE = new Float64Array(0);

const isLists = (column: Column): column is Lists => !Array.isArray(column) && "offsets" in column;

function lengthOf(column: Column): number {
  return isLists(column) ? Math.max(0, column.offsets.length - 1) : column.length;
}

/** The rows that all columns have. */
function rowsOf(columns: Columns): number {
  let rows = Infinity;
  for (const column of Object.values(columns)) rows = Math.min(rows, lengthOf(column));
  return rows === Infinity ? 0 : rows;
}

/** Joins typed arrays in a buffer that doubles, so that many short appends cost little. */
class Growing {
  constructor(
    private buffer: Numbers,
    private length: number,
  ) {}

  get view(): Numbers {
    return this.buffer.subarray(0, this.length);
  }

  push(values: Numbers): void {
    const needed = this.length + values.length;
    if (needed > this.buffer.length) {
      const Type = this.buffer.constructor as new (length: number) => Numbers;
      const larger = new Type(Math.max(needed, 2 * this.buffer.length));
      larger.set(this.view as never);
      this.buffer = larger;
    }
    this.buffer.set(values as never, this.length);
    this.length = needed;
  }
}

export class Table {
  rows: number;
  private columns: Columns;
  private readonly growing = new Map<string, Growing>();

  constructor(columns: Columns = {}) {
    this.columns = columns;
    this.rows = rowsOf(columns);
  }

  /** The column as numbers; empty if there is none. */
  numbers(name: string): Numbers {
    const column = this.columns[name];
    return column && !Array.isArray(column) && !isLists(column) ? column : NONE;
  }

  texts(name: string): string[] {
    const column = this.columns[name];
    return Array.isArray(column) ? column : [];
  }

  list(name: string, row: number): Numbers {
    const column = this.columns[name];
    if (!column || !isLists(column)) return NONE;
    return column.values.subarray(column.offsets[row], column.offsets[row + 1]);
  }

  append(columns: Columns): void {
    if (!this.rows) {
      this.columns = columns;
      this.growing.clear();
    } else
      for (const [name, column] of Object.entries(this.columns)) {
        // A column that the new rows do not have would no longer fit to the others.
        if (columns[name] === undefined) delete this.columns[name];
        else this.columns[name] = this.joined(name, column, columns[name]);
      }
    this.rows = rowsOf(this.columns);
  }

  /** Returns a table of some of the rows. */
  kept(rows: readonly number[]): Table {
    const kept = Object.create(null) as Columns;
    for (const [name, column] of Object.entries(this.columns)) kept[name] = chosen(column, rows);
    return new Table(kept);
  }

  private joined(name: string, column: Column, more: Column): Column {
    if (Array.isArray(column)) {
      // Not by a spread, which fails for very many.
      if (Array.isArray(more)) for (const text of more) column.push(text);
      return column;
    }
    if (Array.isArray(more)) return column;
    if (!isLists(column)) return isLists(more) ? column : this.grow(name, column, more);
    if (!isLists(more)) return column;
    const last = column.offsets[column.offsets.length - 1];
    const shifted = Uint32Array.from(more.offsets.subarray(1), (offset) => offset + last);
    return {
      values: this.grow(`${name}.values`, column.values, more.values),
      offsets: this.grow(`${name}.offsets`, column.offsets, shifted),
    };
  }

  private grow(name: string, column: Numbers, more: Numbers): Numbers {
    let growing = this.growing.get(name);
    if (!growing) this.growing.set(name, (growing = new Growing(column, column.length)));
    growing.push(more);
    return growing.view;
  }
}

function chosen(column: Column, rows: readonly number[]): Column {
  if (Array.isArray(column)) return rows.map((row) => column[row]);
  if (!isLists(column)) return picked(column, rows);
  const offsets = new Uint32Array(rows.length + 1);
  rows.forEach((row, i) => (offsets[i + 1] = offsets[i] + column.offsets[row + 1] - column.offsets[row]));
  const Type = column.values.constructor as new (length: number) => Numbers;
  const values = new Type(offsets[rows.length]);
  rows.forEach((row, i) =>
    values.set(column.values.subarray(column.offsets[row], column.offsets[row + 1]) as never, offsets[i]),
  );
  return { values, offsets };
}

function picked(values: Numbers, rows: readonly number[]): Numbers {
  const Type = values.constructor as new (length: number) => Numbers;
  const out = new Type(rows.length);
  rows.forEach((row, i) => (out[i] = values[row]));
  return out;
}

/** Rows of a table by key and step, in order of steps; takes up appended rows at the next look-up. */
export class StepIndex {
  private readonly rows = new Map<number, number[]>();
  private indexed = 0;

  constructor(
    private readonly table: Table,
    private readonly key: string,
  ) {}

  of(key: number): readonly number[] {
    const steps = this.table.numbers("step");
    const keys = this.table.numbers(this.key);
    for (; this.indexed < steps.length; this.indexed++) {
      const list = this.rows.get(keys[this.indexed]);
      if (list) list.push(this.indexed);
      else this.rows.set(keys[this.indexed], [this.indexed]);
    }
    return this.rows.get(key) ?? [];
  }

  keys(): number[] {
    this.of(-1);
    return [...this.rows.keys()];
  }

  /** The rows of the key with steps up to `step`. */
  upTo(key: number, step: number): readonly number[] {
    const rows = this.of(key);
    return rows.slice(0, upper(rows, this.table.numbers("step"), step));
  }

  /** The newest row of the key at or before the step; -1 if there is none. */
  at(key: number, step: number): number {
    const rows = this.of(key);
    const place = upper(rows, this.table.numbers("step"), step);
    return place ? rows[place - 1] : -1;
  }
}

/** The number of `rows` (sorted by step) whose step is at most `step`. */
function upper(rows: readonly number[], steps: Numbers, step: number): number {
  let low = 0;
  let high = rows.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (steps[rows[middle]] <= step) low = middle + 1;
    else high = middle;
  }
  return low;
}
