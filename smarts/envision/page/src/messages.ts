/** What messages are when they have been decoded. No DOM. */

export type Numbers =
  Uint8Array | Int8Array | Uint16Array | Int16Array | Uint32Array | Int32Array | Float32Array | Float64Array;
/** A column of lists: row i owns values[offsets[i]] to values[offsets[i + 1]]. */
export interface Lists {
  values: Numbers;
  offsets: Numbers;
}
export type Column = Numbers | Lists | string[];
export type Columns = Record<string, Column>;
export type Scalar = null | boolean | number | string;
/** Whose message it is, live: the simulation, and which of its episodes. */
export interface Address {
  source: string;
  serial: number;
}
export interface EpisodeMessage {
  type: "episode";
  facts: Record<string, Scalar>;
  names: Record<string, Record<string, string>>;
  origin: [number, number];
}
export interface MapMessage {
  type: "map";
  digest: string;
  bounds: number[];
  lanes: Columns;
  edges: string[];
}
/** A map that this connection has brought before. */
export interface KnownMapMessage {
  type: "known_map";
  digest: string;
}
export interface TableMessage {
  type: "table";
  name: string;
  columns: Columns;
  append: boolean;
}
export interface VehiclesMessage {
  type: "vehicles";
  columns: Columns;
}
/** States of K steps, decoded: row r of each column is one vehicle at one step; run i owns `count[i]` rows in turn. */
export interface StepsMessage {
  type: "steps";
  step: Int32Array;
  number: Uint32Array;
  begin: Uint16Array;
  count: Uint16Array;
  x: Int32Array;
  y: Int32Array;
  heading: Int32Array;
  speed: Int32Array;
  steer: Int32Array;
  flags: Uint16Array;
  /** The vehicle of each row. */
  rowNumber: Uint32Array;
}
export interface EndMessage {
  type: "end";
  isComplete: boolean;
  remark: string;
}
export interface Source {
  id: string;
  title: string;
  scenario: string;
  /** What drives the egos; empty where it is unknown. */
  policy: string;
  host: string;
  /** Which simulation of its process. */
  world: number;
  episode: number;
  step: number;
  running: boolean;
  rate: number;
}
export interface SourcesMessage {
  type: "sources";
  sources: Source[];
  /** Simulations that run and are not shown. */
  hidden: number;
}
/** Stands for a message that is damaged. */
export interface ErrorMessage {
  type: "error";
  text: string;
}
export type Message = Partial<Address> & Body;
export type Body =
  | EpisodeMessage
  | MapMessage
  | KnownMapMessage
  | TableMessage
  | VehiclesMessage
  | StepsMessage
  | EndMessage
  | SourcesMessage
  | ErrorMessage;
