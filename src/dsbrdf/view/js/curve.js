// Curves over x = cos(theta_d) of a few coefficients, as dsbrdf.model.lobes has them.

/** Values at x of curves of `size` coefficients each, one after the other. */
export function curvesAt(coefficients, size, x) {
  const values = new Float64Array(coefficients.length / size);
  const spans = Math.max(size - 2, 1);
  const span = Math.min(Math.floor(x * spans), spans - 1);
  const u = x * spans - span;
  const low = size === 2 ? 1 - x : (1 - u) * (1 - u) * (span === 0 ? 1 : 0.5);
  const high = size < 3 ? 0 : u * u * (span === spans - 1 ? 1 : 0.5);
  for (let i = 0; i < values.length; i++) {
    const at = i * size + span;
    if (size === 1) values[i] = coefficients[i];
    else values[i] = low * coefficients[at] + (1 - low - high) * coefficients[at + 1];
    if (size > 2) values[i] += high * coefficients[at + 2];
  }
  return values;
}

/** cos(theta_d) at even theta_d, over which curves of different sizes are brought near each other. */
export const PLACES = Array.from({ length: 90 }, (_, i) => Math.cos((Math.PI * (i + 0.5)) / 180));

/** Values (place, function) of the functions of a curve: those of curves with one coefficient 1 and the others 0. */
function design(size) {
  const units = Float64Array.from({ length: size * size }, (_, i) => (i % (size + 1) ? 0 : 1));
  return PLACES.map((x) => Array.from(curvesAt(units, size, x)));
}

/** Solution (row, column) of the positive definite system `matrix` (row, row) for the right sides (row, column). */
function solve(matrix, right) {
  const rows = matrix.map((row, i) => [...row, ...right[i]]);
  rows.forEach((pivot, i) => {
    for (let j = pivot.length - 1; j >= i; j--) pivot[j] /= pivot[i];
    for (const row of rows) {
      if (row === pivot) continue;
      const factor = row[i];
      for (let j = i; j < row.length; j++) row[j] -= factor * pivot[j];
    }
  });
  return rows.map((row) => row.slice(matrix.length));
}

/** Coefficients, `size` a curve, of the curves nearest to rows of values at `PLACES`. */
export function nearestCurves(rows, size) {
  const functions = design(size);
  const transposed = functions[0].map((_, i) => functions.map((at) => at[i]));
  const product = transposed.map((a) => transposed.map((b) => a.reduce((sum, x, p) => sum + x * b[p], 0)));
  const matrix = solve(product, transposed);
  return Float64Array.from({ length: rows.length * size }, (_, i) => {
    const values = rows[Math.floor(i / size)];
    return matrix[i % size].reduce((sum, factor, p) => sum + factor * values[p], 0);
  });
}

/** Curves of `from` coefficients each as the nearest ones of `to`; exactly, where these can. */
export function resized(coefficients, from, to) {
  if (from === to) return Float64Array.from(coefficients);
  const values = PLACES.map((x) => curvesAt(coefficients, from, x));
  return nearestCurves(
    Array.from(values[0], (_, row) => values.map((at) => at[row])),
    to,
  );
}
