/** Matrices of 16 numbers in column-major order, as in WebGL. Transforms are affine. */

export type Matrix = ArrayLike<number>;

export function product(a: Matrix, b: Matrix): number[] {
  return Array.from({ length: 16 }, (_, at) => {
    const [row, column] = [at % 4, at - (at % 4)];
    return a[row] * b[column] + a[row + 4] * b[column + 1] + a[row + 8] * b[column + 2] + a[row + 12] * b[column + 3];
  });
}

/** Inverse of an affine transform, whose last row is 0, 0, 0, 1. */
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

/** Undoes the rotation and mirroring of a transform, but not its scale. */
export function unturned(m: Matrix): number[] {
  const [a, b, c] = [0, 4, 8].map((at) => [m[at], m[at + 1], m[at + 2]].map((value) => value / Math.hypot(m[at], m[at + 1], m[at + 2])));
  return [a[0], b[0], c[0], 0, a[1], b[1], c[1], 0, a[2], b[2], c[2], 0, 0, 0, 0, 1];
}

/** Whether a projection is orthographic. */
export function isParallel(projection: Matrix): boolean {
  return projection[15] === 1;
}

/**
 * Factors and shifts along x and y: from a position in the picture, -1 to 1, to one at distance 1, or, for parallel
 * rays, at any distance.
 */
export function lensOf(projection: Matrix): [number, number, number, number] {
  const [x, y] = isParallel(projection) ? [-projection[12], -projection[13]] : [projection[8], projection[9]];
  return [1 / projection[0], 1 / projection[5], x / projection[0], y / projection[5]];
}

/** The transform of a camera that looks along a unit direction. */
export function lookingAlong(origin: readonly number[], direction: readonly number[]): number[] {
  const cross = (a: readonly number[], b: readonly number[]) => [0, 1, 2].map((axis) => a[(axis + 1) % 3] * b[(axis + 2) % 3] - a[(axis + 2) % 3] * b[(axis + 1) % 3]);
  const back = direction.map((value) => -value);
  const right = cross(Math.abs(back[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0], back);
  const length = Math.hypot(...right);
  const unit = right.map((value) => value / length);
  return [...unit, 0, ...cross(back, unit), 0, ...back, 0, ...origin, 1];
}

/** The columns of the linear part. */
export function linearPart(m: Matrix): number[] {
  return [0, 1, 2, 4, 5, 6, 8, 9, 10].map((at) => m[at]);
}
