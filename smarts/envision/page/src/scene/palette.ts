/** Colours of the scene, for a dark and a light page. */

import { Driver } from "../snapshot";

export type Rgb = readonly [number, number, number];

export const rgb = (hex: string): Rgb => {
  const value = parseInt(hex.slice(1), 16);
  return [((value >> 16) & 255) / 255, ((value >> 8) & 255) / 255, (value & 255) / 255];
};

/** Tones of surfaces and lines: an index into `Theme.tones`. */
export enum Tone {
  Kerb,
  Road,
  Junction,
  Foot,
  Shoulder,
  Bus,
  Bicycle,
  Rail,
  Closed,
  White,
  Edge,
  Yellow,
  Stop,
  Zebra,
}

export interface Theme {
  name: "dark" | "light";
  ground: Rgb;
  tones: Rgb[];
  drivers: Record<Driver, Rgb>;
  shadow: number;
  glass: Rgb;
  tyre: Rgb;
  bubble: Rgb;
  goal: Rgb;
  route: Rgb;
  /** What the chosen agent observes, and the points of its lidar. */
  sight: Rgb;
  lidar: Rgb;
  hit: Rgb;
  /** Factor of lights on surfaces that face up, and of those that face away. */
  light: readonly [number, number];
}

export const STOP_LIGHT = rgb("#ff4d4f");
export const CAUTION_LIGHT = rgb("#ffc043");
export const GO_LIGHT = rgb("#35d07f");

const DRIVERS: Record<Driver, Rgb> = {
  [Driver.Ego]: rgb("#ee3f46"),
  [Driver.Social]: rgb("#ff8b1f"),
  [Driver.Traffic]: rgb("#74b8f5"),
  [Driver.Fallback]: rgb("#2fc9ae"),
  [Driver.Other]: rgb("#e58ad6"),
};

export const DARK: Theme = {
  name: "dark",
  ground: rgb("#0f1319"),
  tones: [
    "#333c49",
    "#252b35",
    "#272d38",
    "#1c222a",
    "#20262e",
    "#2c2b3b",
    "#2b3531",
    "#1a1f27",
    "#1a1e25",
    "#8d97a6",
    "#6d7786",
    "#c49a3e",
    "#d4dae3",
    "#59636f",
  ].map(rgb),
  drivers: DRIVERS,
  shadow: 0.5,
  glass: rgb("#11161e"),
  tyre: rgb("#090b0f"),
  bubble: rgb("#a98bff"),
  goal: rgb("#4be39a"),
  route: rgb("#ff6a70"),
  sight: rgb("#f2e14c"),
  lidar: rgb("#5ef2ff"),
  hit: rgb("#ffd84a"),
  light: [1.0, 0.52],
};

export const LIGHT: Theme = {
  name: "light",
  ground: rgb("#edf0f2"),
  tones: [
    "#9aa3af",
    "#b9c0ca",
    "#bcc3cc",
    "#dde1e6",
    "#ccd2d9",
    "#b7b6cc",
    "#b5c7be",
    "#d3d7dd",
    "#d9dde2",
    "#ffffff",
    "#f4f6f9",
    "#e3a512",
    "#ffffff",
    "#f7f9fb",
  ].map(rgb),
  drivers: {
    ...DRIVERS,
    [Driver.Ego]: rgb("#e0242c"),
    [Driver.Social]: rgb("#f57c00"),
    [Driver.Traffic]: rgb("#5aa5ec"),
    [Driver.Fallback]: rgb("#0f9e88"),
  },
  shadow: 0.34,
  glass: rgb("#27313f"),
  tyre: rgb("#1b1f26"),
  bubble: rgb("#7a4fe0"),
  goal: rgb("#0f9d58"),
  route: rgb("#d7262e"),
  sight: rgb("#8a5a00"),
  lidar: rgb("#0077aa"),
  hit: rgb("#ffb800"),
  light: [1.08, 0.62],
};
