// Rotations as nine numbers, column after column, as WebGL takes them.

export const IDENTITY = [1, 0, 0, 0, 1, 0, 0, 0, 1];

export const column = (m, i) => m.slice(3 * i, 3 * i + 3);
export const transpose = (m) => m.map((_, i) => m[3 * (i % 3) + Math.floor(i / 3)]);
export const apply = (m, v) => [0, 1, 2].map((i) => m[i] * v[0] + m[3 + i] * v[1] + m[6 + i] * v[2]);
export const multiply = (a, b) => [0, 1, 2].flatMap((i) => apply(a, column(b, i)));

/** By an angle in radians about a unit axis, counter-clockwise seen from its tip (Rodrigues). */
export function rotation([x, y, z], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const t = 1 - c;
  // prettier-ignore
  return [
    t * x * x + c, t * x * y + s * z, t * x * z - s * y,
    t * x * y - s * z, t * y * y + c, t * y * z + s * x,
    t * x * z + s * y, t * y * z - s * x, t * z * z + c,
  ];
}
