/** Matrices of 16 numbers, column by column, as WebGL takes them. Those of places keep parallels parallel. */

export type Matrix = ArrayLike<number>;

export function product(a: Matrix, b: Matrix): number[] {
  return Array.from({ length: 16 }, (_, at) => {
    const [row, column] = [at % 4, at - (at % 4)];
    return a[row] * b[column] + a[row + 4] * b[column + 1] + a[row + 8] * b[column + 2] + a[row + 12] * b[column + 3];
  });
}

/** Of a place: its last row is 0, 0, 0, 1. */
export function inverse(m: Matrix): number[] {
  const minors = [
    m[5] * m[10] - m[9] * m[6], m[9] * m[2] - m[1] * m[10], m[1] * m[6] - m[5] * m[2],
    m[8] * m[6] - m[4] * m[10], m[0] * m[10] - m[8] * m[2], m[4] * m[2] - m[0] * m[6],
    m[4] * m[9] - m[8] * m[5], m[8] * m[1] - m[0] * m[9], m[0] * m[5] - m[4] * m[1],
  ];
  const determinant = m[0] * minors[0] + m[4] * minors[1] + m[8] * minors[2];
  const [a, b, c, d, e, f, g, h, i] = minors.map((minor) => minor / determinant);
  const moved = [[a, d, g], [b, e, h], [c, f, i]].map(([x, y, z]) => -(x * m[12] + y * m[13] + z * m[14]));
  return [a, b, c, 0, d, e, f, 0, g, h, i, 0, ...moved, 1];
}

/** What undoes the rotation of a place, without its scale. A place that mirrors does so along its x. */
export function unturned(m: Matrix): number[] {
  const columns = [0, 4, 8].map((at) => [m[at], m[at + 1], m[at + 2]].map((value) => value / Math.hypot(m[at], m[at + 1], m[at + 2])));
  const [x, y, z] = columns;
  const side = x[0] * (y[1] * z[2] - y[2] * z[1]) + x[1] * (y[2] * z[0] - y[0] * z[2]) + x[2] * (y[0] * z[1] - y[1] * z[0]);
  if (side < 0) columns[0] = x.map((value) => -value);
  const [a, b, c] = columns;
  return [a[0], b[0], c[0], 0, a[1], b[1], c[1], 0, a[2], b[2], c[2], 0, 0, 0, 0, 1];
}

/** Columns of the part without a shift. */
export function linearPart(m: Matrix): number[] {
  return [0, 1, 2, 4, 5, 6, 8, 9, 10].map((at) => m[at]);
}
