// The numbers of a material as the textures that the shaders read (dsbrdf/shader/texture.glsl, sphere.glsl).

import { inRgb, SHARED } from "./material.js";
import { samplingShares } from "./sampler.js";

/** Columns of a packed profile, evenly spaced in the square root of theta_h as a MERL table is. */
const PROFILE_COLUMNS = 180;

/** The texture of `texture.glsl`, one row of texels: {width, height, data}. */
export function packParameters(material) {
  const rgb = inRgb(material);
  const { sizes, nLobes } = rgb;
  const most = Math.max(...Object.values(sizes));
  const coefficient = (key, row, j) => (j < sizes[key] ? rgb[key][row * sizes[key] + j] : 0);
  const places = Array.from({ length: most }, (_, j) => j);
  const ofLobe = (k) => [
    ...places.map((j) => SHARED.map((key) => coefficient(key, k, j))),
    ...places.map((j) => [...[0, 1, 2].map((channel) => coefficient("colour", channel * nLobes + k, j)), 0]),
  ];
  const texels = [
    SHARED.map((key) => sizes[key]),
    [sizes.colour, most, nLobes, 0],
    ...Array.from({ length: nLobes }, (_, k) => ofLobe(k)).flat(),
    ...samplingShares(rgb),
  ];
  const data = Float32Array.from(texels.flat());
  return { width: data.length / 4, height: 1, data };
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
  const colours = (values, slice, nThetaH) =>
    rgb.map((weights) =>
      Float64Array.from({ length: nThetaH }, (_, i) =>
        weights.reduce((sum, w, c) => (w ? sum + w * values[(slice * nChannels + c) * nThetaH + i] : sum), 0),
      ),
    );
  const nSlices = profile.thetaD.length;
  const nThetaH = profile.mean.length / (nSlices * nChannels);
  const data = new Float32Array(4 * 2 * PROFILE_COLUMNS * nSlices);
  const part = (values, row) => values.subarray(row * nThetaH, (row + 1) * nThetaH);
  for (let slice = 0; slice < nSlices; slice++) {
    const thetaH = part(profile.thetaH, profile.thetaH.length > nThetaH ? slice : 0);
    const [mean, amplitude] = [profile.mean, profile.amplitude].map((all) => colours(all, slice, nThetaH));
    for (let column = 0; column < PROFILE_COLUMNS; column++) {
      const x = (Math.PI / 2) * (column / (PROFILE_COLUMNS - 1)) ** 2;
      const at = (rows) => rows.map((row) => interpolate(thetaH, row, x));
      const [means, amplitudes] = [at(mean), at(amplitude)];
      const there = means.every(Number.isFinite);
      const start = 4 * (2 * PROFILE_COLUMNS * slice + column);
      const waves = there && amplitudes.every(Number.isFinite) ? amplitudes : [0, 0, 0];
      if (there) data.set([...means, 1], start);
      data.set([...waves, profile.thetaD[slice]], start + 4 * PROFILE_COLUMNS);
    }
  }
  return { width: 2 * PROFILE_COLUMNS, height: nSlices, data };
}
