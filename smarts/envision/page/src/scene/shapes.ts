/** The bodies of vehicle classes. */

import { Part, Shape } from "./shape";

const CAR = new Shape(4.5, 1.85, 1.5, (car) =>
  car
    .wheels([-0.3, 0.31], 0.147, 0.44, 0.508)
    .loft(
      [
        [0.11, -0.48, 0.48, 0.46, 0.5],
        [0.26, -0.5, 0.5, 0.49, 0.55],
        [0.52, -0.5, 0.498, 0.495, 0.55],
        [0.63, -0.485, 0.46, 0.455, 0.5],
      ],
      [Part.Body, Part.Body, Part.Body],
      Part.Body,
    )
    .loft(
      [
        [0.62, -0.41, 0.24, 0.435, 0.4],
        [0.94, -0.31, 0.07, 0.36, 0.35],
      ],
      [Part.Glass],
      Part.Body,
    )
    .loft(
      [
        [0.93, -0.32, 0.08, 0.365, 0.35],
        [0.985, -0.29, 0.055, 0.335, 0.3],
      ],
      [Part.Body],
      Part.Body,
    )
    .lights([0.4, 0.645], 0.49, -0.495),
);

const bus = (length: number, glass: number) =>
  new Shape(length, 2.55, 3.1, (shape) =>
    shape
      .wheels([-0.28, 0.33], 1.05 / length, 0.3, 0.505)
      .loft(
        [
          [0.1, -0.495, 0.495, 0.48, 0.3],
          [0.2, -0.5, 0.5, 0.5, 0.3],
          [glass, -0.5, 0.5, 0.5, 0.3],
        ],
        [Part.Body, Part.Body],
        Part.Body,
      )
      .loft(
        [
          [glass, -0.498, 0.5, 0.497, 0.3],
          [0.84, -0.495, 0.492, 0.485, 0.3],
        ],
        [Part.Glass],
        Part.Body,
      )
      .loft(
        [
          [0.84, -0.498, 0.495, 0.49, 0.32],
          [0.96, -0.49, 0.482, 0.46, 0.35],
        ],
        [Part.Body],
        Part.Body,
      )
      .loft(
        [
          [0.95, -0.2, 0.06, 0.3, 0.2],
          [1, -0.19, 0.05, 0.27, 0.2],
        ],
        [Part.Body],
        Part.Cargo,
      )
      .lights([0.22, 0.34], 0.5, -0.5),
  );

const TRUCK = new Shape(7.1, 2.4, 3.0, (truck) =>
  truck
    .wheels([-0.3, 0.36], 0.14, 0.32, 0.505)
    .loft(
      [
        [0.13, -0.5, 0.26, 0.42, 0.1],
        [0.26, -0.5, 0.26, 0.42, 0.1],
      ],
      [Part.Tyre],
      Part.Tyre,
    )
    .loft(
      [
        [0.26, -0.5, 0.24, 0.5, 0.08],
        [0.97, -0.5, 0.24, 0.5, 0.08],
        [1, -0.495, 0.235, 0.48, 0.08],
      ],
      [Part.Body, Part.Body],
      Part.Cargo,
    )
    .loft(
      [
        [0.13, 0.27, 0.5, 0.48, 0.3],
        [0.42, 0.27, 0.5, 0.48, 0.3],
      ],
      [Part.Body],
      Part.Body,
    )
    .loft(
      [
        [0.42, 0.27, 0.495, 0.475, 0.3],
        [0.7, 0.27, 0.455, 0.45, 0.25],
      ],
      [Part.Glass],
      Part.Body,
    )
    .loft(
      [
        [0.7, 0.27, 0.46, 0.455, 0.25],
        [0.78, 0.275, 0.43, 0.42, 0.25],
      ],
      [Part.Body],
      Part.Body,
    )
    .lights([0.18, 0.3], 0.5, -0.5),
);

const TRAILER = new Shape(13.6, 2.55, 3.4, (trailer) =>
  trailer
    .wheels([-0.4, -0.32, -0.24], 0.07, 0.28, 0.505)
    .loft(
      [
        [0.14, -0.5, 0.5, 0.42, 0.1],
        [0.26, -0.5, 0.5, 0.42, 0.1],
      ],
      [Part.Tyre],
      Part.Tyre,
    )
    .loft(
      [
        [0.26, -0.5, 0.5, 0.5, 0.08],
        [0.98, -0.5, 0.5, 0.5, 0.08],
        [1, -0.497, 0.497, 0.48, 0.08],
      ],
      [Part.Body, Part.Body],
      Part.Cargo,
    )
    .lights([0.18, 0.3], 0.5, -0.5),
);

const MOTORCYCLE = new Shape(2.2, 0.9, 1.45, (cycle) =>
  cycle
    .box(Part.Tyre, [-0.5, -0.2], [-0.12, 0.12], [0, 0.44])
    .box(Part.Tyre, [0.22, 0.5], [-0.1, 0.1], [0, 0.44], [0.36, 0])
    .loft(
      [
        [0.3, -0.36, 0.36, 0.2, 0.2],
        [0.58, -0.42, 0.34, 0.24, 0.2],
      ],
      [Part.Body],
      Part.Body,
    )
    .box(Part.Tyre, [0.18, 0.25], [-0.45, 0.45], [0.62, 0.68])
    .loft(
      [
        [0.56, -0.24, 0.06, 0.32, 0.2],
        [0.84, -0.12, 0.14, 0.36, 0.2],
      ],
      [Part.Glass],
      Part.Glass,
    )
    .loft(
      [
        [0.82, -0.03, 0.16, 0.19, 0.14],
        [1, 0.0, 0.14, 0.14, 0.12],
      ],
      [Part.Body],
      Part.Body,
    )
    .lights([0.44, 0.6], 0.42, -0.44, 0.3),
);

const BICYCLE = new Shape(1.6, 0.65, 1.7, (cycle) =>
  cycle
    .box(Part.Tyre, [-0.5, -0.12], [-0.06, 0.06], [0, 0.38])
    .box(Part.Tyre, [0.12, 0.5], [-0.06, 0.06], [0, 0.38], [0.31, 0])
    .box(Part.Body, [-0.3, 0.3], [-0.07, 0.07], [0.3, 0.42])
    .box(Part.Tyre, [0.24, 0.3], [-0.45, 0.45], [0.58, 0.62])
    .loft(
      [
        [0.5, -0.22, 0.08, 0.32, 0.2],
        [0.84, -0.08, 0.16, 0.38, 0.2],
      ],
      [Part.Body],
      Part.Body,
    )
    .loft(
      [
        [0.84, -0.04, 0.14, 0.2, 0.14],
        [1, 0.0, 0.12, 0.16, 0.12],
      ],
      [Part.Glass],
      Part.Glass,
    )
    .lights([0.44, 0.5], 0.3, -0.3, 0.2),
);

const PEDESTRIAN = new Shape(0.45, 0.5, 1.719, (person) =>
  person
    .box(Part.Tyre, [-0.25, 0.25], [-0.3, -0.04], [0, 0.48])
    .box(Part.Tyre, [-0.25, 0.25], [0.04, 0.3], [0, 0.48])
    .loft(
      [
        [0.46, -0.36, 0.36, 0.4, 0.3],
        [0.82, -0.4, 0.4, 0.5, 0.3],
      ],
      [Part.Body],
      Part.Body,
    )
    .loft(
      [
        [0.84, -0.3, 0.3, 0.22, 0.2],
        [1, -0.26, 0.26, 0.18, 0.18],
      ],
      [Part.Glass],
      Part.Glass,
    )
    .lights([0.6, 0.64], 0.3, -0.4, 0.1),
);

export const SHAPES: readonly Shape[] = [
  CAR,
  bus(12, 0.42),
  bus(12.5, 0.5),
  TRUCK,
  TRAILER,
  MOTORCYCLE,
  BICYCLE,
  PEDESTRIAN,
];

/** The shape of a VehicleKind. */
export const shapeOf = (kind: number): number => (kind >= 0 && kind < SHAPES.length ? kind : 0);
