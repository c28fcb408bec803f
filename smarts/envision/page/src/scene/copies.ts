/** A small shape many times, its corners written out: drawing by software takes far longer for instances. */

import { BufferAttribute, BufferGeometry, DynamicDrawUsage, InterleavedBuffer, InterleavedBufferAttribute } from "three";

const FEWEST = 32;

export interface Stencil {
  /** Attributes of the shape's corners: so many numbers each. */
  attributes: Readonly<Record<string, { values: ArrayLike<number>; size: number }>>;
  corners: number;
  index: ArrayLike<number>;
}

export class Copies {
  readonly geometry = new BufferGeometry();
  count = 0;
  /** The numbers of the copy that was added last begin where `add` says; `end` writes them to all corners. */
  values!: Float32Array;
  private readonly stride: number;
  private capacity = 0;
  private buffer!: InterleavedBuffer;

  /** `sizes` are the numbers of a copy, by attribute. */
  constructor(
    private readonly stencil: Stencil,
    private readonly sizes: Readonly<Record<string, number>>,
  ) {
    this.stride = Object.values(sizes).reduce((sum, size) => sum + size, 0);
    this.grow(FEWEST);
  }

  begin(): void {
    this.count = 0;
  }

  /** Adds a copy; returns where its numbers begin. */
  add(): number {
    if (this.count === this.capacity) this.grow(2 * this.capacity);
    return this.stride * this.stencil.corners * this.count++;
  }

  /** Draws what was added. */
  end(): void {
    const { stride, values } = this;
    const { corners, index } = this.stencil;
    this.geometry.setDrawRange(0, index.length * this.count);
    if (!this.count) return;
    for (let i = 0; i < this.count; i++) {
      const begin = i * corners * stride;
      for (let corner = 1; corner < corners; corner++)
        values.copyWithin(begin + corner * stride, begin, begin + stride);
    }
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, stride * corners * this.count);
    this.buffer.needsUpdate = true;
  }

  dispose(): void {
    this.geometry.dispose();
  }

  private grow(capacity: number): void {
    const { attributes, corners, index } = this.stencil;
    const values = new Float32Array(capacity * corners * this.stride);
    if (this.capacity) {
      values.set(this.values);
      this.geometry.dispose();
    }
    this.capacity = capacity;
    this.values = values;
    for (const [name, { values: each, size }] of Object.entries(attributes)) {
      const all = new Float32Array(capacity * each.length);
      for (let i = 0; i < capacity; i++) all.set(each, i * each.length);
      this.geometry.setAttribute(name, new BufferAttribute(all, size));
    }
    const places = new Uint32Array(capacity * index.length);
    for (let i = 0; i < places.length; i++)
      places[i] = index[i % index.length] + corners * Math.floor(i / index.length);
    this.geometry.setIndex(new BufferAttribute(places, 1));
    this.buffer = new InterleavedBuffer(values, this.stride);
    this.buffer.setUsage(DynamicDrawUsage);
    let offset = 0;
    for (const [name, size] of Object.entries(this.sizes)) {
      this.geometry.setAttribute(name, new InterleavedBufferAttribute(this.buffer, size, offset));
      offset += size;
    }
  }
}
