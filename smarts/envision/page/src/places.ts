/** Where views lie on the stage. No DOM. */

/** Columns and rows of a grid for so many views. */
export function gridOf(count: number, isPortrait: boolean): [number, number] {
  const long = Math.ceil(Math.sqrt(count));
  const short = Math.ceil(count / long);
  return isPortrait ? [short, long] : [long, short];
}
