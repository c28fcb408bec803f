/** Reads compact episodes: a head, then messages, each behind its length. No DOM. */

import { decode, LARGEST_MESSAGE } from "./format";
import type { Columns, Message } from "./messages";
import { FormatError } from "./msgpack";

export const MAGIC = "SMARTSEP";
/** Bytes of all tables and maps of a recording. */
const LARGEST_TABLES = 512 << 20;

export interface Container {
  messages: Message[];
  /** Why the rest is missing; empty if the file is whole. */
  damage: string;
}

export const isEpisode = (bytes: Uint8Array): boolean =>
  String.fromCharCode(...bytes.subarray(0, MAGIC.length)) === MAGIC;

/** Calls `take` with the messages of a compact episode in turn, and with their bytes.

Returns why the rest is missing, "" if the file is whole. What is cut off or damaged ends the reading.
Throws FormatError where there is no episode at all. */
export async function readContainer(
  bytes: Uint8Array,
  take: (message: Message, packed: Uint8Array) => void,
): Promise<string> {
  if (!isEpisode(bytes)) throw new FormatError("this is not a compact episode");
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  let hasBegun = false;
  let damage = "";
  let size = 0;
  for (let at = MAGIC.length; at < bytes.length && !damage; ) {
    const begin = at + 4;
    const length = begin <= bytes.length ? view.getUint32(at, true) : 0;
    at = begin + length;
    if (length > LARGEST_MESSAGE) damage = "a message is larger than 8 MB";
    else if (at > bytes.length) damage = "the recording is cut off";
    if (damage) break;
    const packed = bytes.subarray(begin, at);
    try {
      // One after the other: all at once could take much memory.
      const message = await decode(packed);
      if (!message) continue;
      hasBegun ||= message.type === "episode";
      if (!hasBegun) throw new FormatError("the recording does not begin with its episode");
      size += sizeOf(message);
      if (size > LARGEST_TABLES)
        throw new FormatError(`the tables of the recording are larger than ${LARGEST_TABLES >> 20} MB`);
      take(message, packed);
    } catch (error) {
      if (!(error instanceof FormatError)) throw error;
      if (!hasBegun) throw error;
      damage = error.message;
    }
  }
  if (!hasBegun) throw new FormatError(damage || "the recording is empty");
  return damage;
}

/** Returns all messages of a compact episode. */
export async function decodeContainer(bytes: Uint8Array): Promise<Container> {
  const messages: Message[] = [];
  const damage = await readContainer(bytes, (message) => messages.push(message));
  return { messages, damage };
}

/** The bytes of what a recording keeps of a message; states may be dropped and decoded again. */
function sizeOf(message: Message): number {
  if (message.type === "table" || message.type === "vehicles") return sizeOfColumns(message.columns);
  return message.type === "map" ? sizeOfColumns(message.lanes) : 0;
}

function sizeOfColumns(columns: Columns): number {
  let size = 0;
  for (const column of Object.values(columns))
    if (Array.isArray(column)) size += column.reduce((sum, text) => sum + 2 * text.length + 16, 0);
    else if ("offsets" in column) size += column.values.byteLength + column.offsets.byteLength;
    else size += column.byteLength;
  return size;
}
