/** Tables of a recorded episode: columns by name, rows that live streams append. No DOM. */

import type { Column, Columns, Lists, Numbers } from "./format";

const MOST_ROWS = 400_000;
const NONE = new Float64Array(0);

const isLists = (column: Column): column is Lists => !Array.isArray(column) && "offsets" in column;

function lengthOf(column: Column): number {
  return isLists(column) ? Math.max(0, column.offsets.length - 1) : column.length;
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
    this.rows = Math.min(...Object.values(columns).map(lengthOf), Infinity);
    if (this.rows === Infinity) this.rows = 0;
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
    const added = new Table(columns);
    if (!this.rows || this.rows > MOST_ROWS) {
      this.columns = columns;
      this.rows = added.rows;
      this.growing.clear();
      return;
    }
    for (const [name, column] of Object.entries(this.columns))
      this.columns[name] = this.joined(name, column, columns[name]);
    this.rows += added.rows;
  }

  private joined(name: string, column: Column, more: Column | undefined): Column {
    if (more === undefined) return column;
    if (Array.isArray(column)) return Array.isArray(more) ? (column.push(...more), column) : column;
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
    if (this.indexed > steps.length) {
      this.rows.clear();
      this.indexed = 0;
    }
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
