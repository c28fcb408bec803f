/** Numbers of instances in one buffer, which is sent as a whole: many small uploads cost more than their bytes. */

import {
  DynamicDrawUsage,
  type InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
} from "three";

const FEWEST = 32;

export class Instances {
  count = 0;
  /** The numbers of instance i begin at i * stride. */
  values!: Float32Array;
  readonly stride: number;
  private capacity = 0;
  private buffer!: InstancedInterleavedBuffer;

  /** Adds attributes with so many numbers each to a geometry. */
  constructor(
    private readonly geometry: InstancedBufferGeometry,
    private readonly sizes: Readonly<Record<string, number>>,
  ) {
    this.stride = Object.values(sizes).reduce((sum, size) => sum + size, 0);
    this.grow(FEWEST);
  }

  begin(): void {
    this.count = 0;
  }

  /** Adds an instance; returns where its numbers begin. */
  add(): number {
    if (this.count === this.capacity) this.grow(2 * this.capacity);
    return this.stride * this.count++;
  }

  /** Draws what was added. */
  end(): void {
    this.geometry.instanceCount = this.count;
    if (!this.count) return;
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, this.stride * this.count);
    this.buffer.needsUpdate = true;
  }

  private grow(capacity: number): void {
    const values = new Float32Array(capacity * this.stride);
    if (this.capacity) {
      values.set(this.values);
      this.geometry.dispose();
    }
    this.capacity = capacity;
    this.values = values;
    this.buffer = new InstancedInterleavedBuffer(values, this.stride);
    this.buffer.setUsage(DynamicDrawUsage);
    let offset = 0;
    for (const [name, size] of Object.entries(this.sizes)) {
      this.geometry.setAttribute(name, new InterleavedBufferAttribute(this.buffer, size, offset));
      offset += size;
    }
  }
}
