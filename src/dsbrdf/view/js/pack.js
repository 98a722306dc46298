// The numbers of a material as the textures that the shaders read (dsbrdf/shader/texture.glsl, sphere.glsl).

import { SHARED, withChannels } from "./material.js";
import { samplingShares } from "./sampler.js";

/** Columns of a packed profile, evenly spaced in the square root of theta_h as a MERL table is. */
const PROFILE_COLUMNS = 180;

/** The texture of `texture.glsl`, a row for each lobe and one for the sampler: {width, height, data}. */
export function packParameters(material) {
  const { sizes, nLobes } = material;
  const most = Math.max(...Object.values(sizes));
  const rgb = withChannels(material, material.rgb);
  const shares = samplingShares(rgb).flat();
  const width = Math.max(2 + 2 * most, shares.length / 4);
  const data = new Float32Array(4 * width * (nLobes + 1));
  for (let k = 0; k < nLobes; k++) {
    const put = (column, values) => data.set(values, 4 * (width * k + column));
    const coefficients = (key, row, j) => rgb[key][row * sizes[key] + j];
    const shared = (value) => SHARED.map((key) => value(key));
    put(
      0,
      shared((key) => sizes[key]),
    );
    put(1, [sizes.colour, most]);
    for (let j = 0; j < most; j++) {
      put(
        2 + j,
        shared((key) => (j < sizes[key] ? coefficients(key, k, j) : 0)),
      );
    }
    for (let j = 0; j < sizes.colour; j++) {
      put(
        2 + most + j,
        [0, 1, 2].map((channel) => coefficients("colour", channel * nLobes + k, j)),
      );
    }
  }
  data.set(shares, 4 * width * nLobes);
  return { width, height: nLobes + 1, data };
}

/** Value of a curve at x by linear interpolation between its samples; NaN beyond them. */
function interpolate(xs, ys, x) {
  let i = xs.findIndex((at) => at >= x);
  if (i === 0 && x === xs[0]) i = 1;
  if (i <= 0) return NaN;
  return ys[i - 1] + ((ys[i] - ys[i - 1]) * (x - xs[i - 1])) / (xs[i] - xs[i - 1]);
}

/** The texture of measured values in `sphere.glsl`, a row for each slice: {width, height, data}. */
export function packProfile({ profile, nChannels, rgb }) {
  const nSlices = profile.thetaD.length;
  const nThetaH = profile.mean.length / (nSlices * nChannels);
  const data = new Float32Array(4 * 2 * PROFILE_COLUMNS * nSlices);
  const part = (values, row) => values.subarray(row * nThetaH, (row + 1) * nThetaH);
  for (let slice = 0; slice < nSlices; slice++) {
    const thetaH = part(profile.thetaH, profile.thetaH.length > nThetaH ? slice : 0);
    for (let column = 0; column < PROFILE_COLUMNS; column++) {
      const x = (Math.PI / 2) * (column / (PROFILE_COLUMNS - 1)) ** 2;
      const at = (values) => rgb.map((c) => interpolate(thetaH, part(values, slice * nChannels + c), x));
      const [means, amplitudes] = [at(profile.mean), at(profile.amplitude)];
      const there = means.every(Number.isFinite);
      const start = 4 * (2 * PROFILE_COLUMNS * slice + column);
      if (there) data.set([...means, 1], start);
      if (there && amplitudes.every(Number.isFinite)) data.set(amplitudes, start + 4 * PROFILE_COLUMNS);
    }
  }
  return { width: 2 * PROFILE_COLUMNS, height: nSlices, data };
}
