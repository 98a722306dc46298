// The numbers of a material as the textures that the shaders read (dsbrdf/shader/texture.glsl, sphere.glsl).

/** Columns of a packed profile, evenly spaced in the square root of theta_h as a MERL table is. */
const PROFILE_COLUMNS = 180;
/** Brightness of a lobe below which it is sampled as if it were as bright. */
const MIN_KAPPA = 1e-9;

/** 1 / C of a lobe (Eq. 4), its integral over half vectors: the series in kappa, all terms positive. */
export function lobeIntegral(kappa, gamma) {
  let sum = 0;
  let power = 1;
  for (let n = 1; n <= 1000; n++) {
    power *= kappa / n;
    const term = power / (n * gamma + 1);
    sum += term;
    if (n > kappa && term < 1e-12 * sum) break;
  }
  return 2 * Math.PI * sum;
}

/** Red, green and blue of a list of channels: three as they are, else the last, the middle and the first one. */
export function colour(channels) {
  if (channels.length === 3) return channels;
  return [1, 0.5, 0].map((place) => channels[Math.round(place * (channels.length - 1))]);
}
const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

/** Parameters (slice, lobe) of a material: kappa, gamma and beta of each colour, and what the sampler takes. */
export function lobeNumbers(material, slice, k) {
  const { nChannels, nLobes } = material;
  const of = (values) =>
    Array.from({ length: nChannels }, (_, c) => values[(slice * nChannels + c) * nLobes + k]);
  const [kappa, gamma, beta] = [of(material.kappa), of(material.gamma), of(material.beta)];
  const sampling = [Math.max(mean(kappa), MIN_KAPPA), mean(gamma)];
  sampling.push(lobeIntegral(...sampling));
  return { kappa: colour(kappa), gamma: colour(gamma), beta: colour(beta), sampling };
}

/** Spike of each colour in a slice. */
export function spikeNumbers(material, slice) {
  const { nChannels, spike } = material;
  return colour(Array.from(spike.subarray(slice * nChannels, (slice + 1) * nChannels)));
}

/** The texture of `texture.glsl`: {width, height, data}. */
export function packParameters(material) {
  const width = 1 + 3 * material.nLobes;
  const rows = Array.from(material.thetaD, (thetaD, slice) => {
    const lobes = Array.from({ length: material.nLobes }, (_, k) => {
      const { kappa, gamma, beta, sampling } = lobeNumbers(material, slice, k);
      return [...kappa, sampling[0], ...gamma, sampling[1], ...beta, sampling[2]];
    });
    return [...spikeNumbers(material, slice), thetaD, ...lobes.flat()];
  });
  return { width, height: rows.length, data: new Float32Array(rows.flat()) };
}

/** The material with the lobes that are on, scaled. */
export function scaledMaterial(material, { enabled, kappaScale, gammaScale, spike }) {
  const { nLobes } = material;
  const kept = Array.from({ length: nLobes }, (_, k) => k).filter((k) => enabled[k]);
  const pick = (values, scale) => {
    const rows = values.length / nLobes;
    return Float32Array.from({ length: rows * kept.length }, (_, i) => {
      const k = kept[i % kept.length];
      return values[Math.floor(i / kept.length) * nLobes + k] * (scale?.[k] ?? 1);
    });
  };
  return {
    ...material,
    nLobes: kept.length,
    kappa: pick(material.kappa, kappaScale),
    gamma: pick(material.gamma, gammaScale),
    beta: pick(material.beta, null),
    spike: spike ? material.spike : new Float32Array(material.spike.length),
  };
}

/** Value of a curve at x by linear interpolation between its samples; NaN beyond them. */
function interpolate(xs, ys, x) {
  let i = xs.findIndex((at) => at >= x);
  if (i === 0 && x === xs[0]) i = 1;
  if (i <= 0) return NaN;
  return ys[i - 1] + ((ys[i] - ys[i - 1]) * (x - xs[i - 1])) / (xs[i] - xs[i - 1]);
}

/** The texture of measured values in `sphere.glsl`, a row for each slice: {width, height, data}. */
export function packProfile(profile, nChannels) {
  const nSlices = profile.thetaD.length;
  const nThetaH = profile.mean.length / (nSlices * nChannels);
  const data = new Float32Array(4 * 2 * PROFILE_COLUMNS * nSlices);
  const part = (values, row) => values.subarray(row * nThetaH, (row + 1) * nThetaH);
  for (let slice = 0; slice < nSlices; slice++) {
    const thetaH = part(profile.thetaH, profile.thetaH.length > nThetaH ? slice : 0);
    for (let column = 0; column < PROFILE_COLUMNS; column++) {
      const x = (Math.PI / 2) * (column / (PROFILE_COLUMNS - 1)) ** 2;
      const at = (values) =>
        colour(
          Array.from({ length: nChannels }, (_, c) =>
            interpolate(thetaH, part(values, slice * nChannels + c), x),
          ),
        );
      const [means, amplitudes] = [at(profile.mean), at(profile.amplitude)];
      const there = means.every(Number.isFinite);
      const start = 4 * (2 * PROFILE_COLUMNS * slice + column);
      if (there) data.set([...means, 1], start);
      if (there && amplitudes.every(Number.isFinite)) data.set(amplitudes, start + 4 * PROFILE_COLUMNS);
    }
  }
  return { width: 2 * PROFILE_COLUMNS, height: nSlices, data };
}
