/** Decodes msgpack. No DOM. */

const DEEPEST = 16;
/** Lists and maps in one message, and their keys: each takes far more memory than its bytes. */
const MOST_PARTS = 200_000;
const MOST_KEYS = 200_000;
const SHORT = 24;

export type Raw = null | boolean | number | string | Uint8Array | Raw[] | { [key: string]: Raw };
export type RawMap = { [key: string]: Raw };

/** What is wrong with the bytes, in words that the page shows. */
export class FormatError extends Error {}

/** Decodes msgpack without extensions; binary values are views of the input. */
export function unpack(bytes: Uint8Array): Raw {
  const reader = new Reader(bytes);
  const value = reader.value(0);
  if (reader.at !== bytes.length) throw new FormatError("a message has bytes after its end");
  return value;
}

class Reader {
  at = 0;
  private parts = 0;
  private keys = 0;
  private readonly view: DataView;
  private readonly text = new TextDecoder("utf-8", { fatal: false });

  constructor(private readonly bytes: Uint8Array) {
    this.view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  value(depth: number): Raw {
    if (depth > DEEPEST) throw new FormatError("a message is nested too deeply");
    const head = this.view.getUint8(this.take(1));
    if (head < 0x80) return head;
    if (head < 0x90) return this.map(head & 15, depth);
    if (head < 0xa0) return this.list(head & 15, depth);
    if (head < 0xc0) return this.string(head & 31);
    if (head >= 0xe0) return head - 256;
    return this.long(head, depth);
  }

  private long(head: number, depth: number): Raw {
    const view = this.view;
    switch (head) {
      case 0xc0:
        return null;
      case 0xc2:
        return false;
      case 0xc3:
        return true;
      case 0xc4:
        return this.binary(this.size(1));
      case 0xc5:
        return this.binary(this.size(2));
      case 0xc6:
        return this.binary(this.size(4));
      case 0xca:
        return view.getFloat32(this.take(4));
      case 0xcb:
        return view.getFloat64(this.take(8));
      case 0xcc:
      case 0xcd:
      case 0xce:
        return this.size(1 << (head - 0xcc));
      case 0xcf:
        return Number(view.getBigUint64(this.take(8)));
      case 0xd0:
        return view.getInt8(this.take(1));
      case 0xd1:
        return view.getInt16(this.take(2));
      case 0xd2:
        return view.getInt32(this.take(4));
      case 0xd3:
        return Number(view.getBigInt64(this.take(8)));
      case 0xd9:
        return this.string(this.size(1));
      case 0xda:
        return this.string(this.size(2));
      case 0xdb:
        return this.string(this.size(4));
      case 0xdc:
        return this.list(this.size(2), depth);
      case 0xdd:
        return this.list(this.size(4), depth);
      case 0xde:
        return this.map(this.size(2), depth);
      case 0xdf:
        return this.map(this.size(4), depth);
      default:
        throw new FormatError(`a message has a value of unknown type 0x${head.toString(16)}`);
    }
  }

  private take(count: number): number {
    const at = this.at;
    if (at + count > this.bytes.length) throw new FormatError("a message ends too early");
    this.at += count;
    return at;
  }

  private size(width: number): number {
    const at = this.take(width);
    return width === 1
      ? this.view.getUint8(at)
      : width === 2
        ? this.view.getUint16(at)
        : this.view.getUint32(at);
  }

  private binary(count: number): Uint8Array {
    const at = this.take(count);
    return this.bytes.subarray(at, at + count);
  }

  private string(count: number): string {
    const bytes = this.binary(count);
    if (count > SHORT) return this.text.decode(bytes);
    // Most texts are short names, for which the decoder is slow.
    let text = "";
    for (const byte of bytes) {
      if (byte > 0x7f) return this.text.decode(bytes);
      text += String.fromCharCode(byte);
    }
    return text;
  }

  /** Counts a list or a map. */
  private open(count: number, keys: number): void {
    if (count > this.bytes.length - this.at) throw new FormatError("a message ends too early");
    this.keys += keys;
    if (++this.parts > MOST_PARTS || this.keys > MOST_KEYS) throw new FormatError("a message has too many parts");
  }

  private list(count: number, depth: number): Raw[] {
    this.open(count, 0);
    const values: Raw[] = [];
    for (let i = 0; i < count; i++) values.push(this.value(depth + 1));
    return values;
  }

  private map(count: number, depth: number): RawMap {
    this.open(2 * count, count);
    const values = Object.create(null) as RawMap;
    for (let i = 0; i < count; i++) {
      const key = this.value(depth + 1);
      if (typeof key === "object" && key !== null) throw new FormatError("a message has a key that is no text");
      values[String(key)] = this.value(depth + 1);
    }
    return values;
  }
}
