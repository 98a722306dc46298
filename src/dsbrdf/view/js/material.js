// Evaluation of a model in JavaScript, as dsbrdf.model.evaluation does it, and models made from others.
//
// A model: {name, channels: names, nChannels, nLobes, rgb: weights of the channels in red, green and blue,
//   falseColours: whether they only stand for these; sizes: {scale, gamma, beta, falloff, colour}: coefficients of a curve; and by the same names Float32Array
//   (lobe, coefficient), colour (channel, lobe, coefficient)}.
// ln(kappa) is the sum of the curves scale and colour, ln(gamma) is the curve gamma.

import { curvesAt, nearestCurves, PLACES, resized } from "./curve.js";
import { meta } from "./meta.js";

const { azimuthalWidth, maxLnKappa, maxFactor, dark, heights } = meta.constants;

export const SHARED = ["scale", "gamma", "beta", "falloff"];
/** The scale of a lobe that is off. */
const OFF = -1e3;
/** Azimuths of a mean over phi_d. */
const N_PHI = 8;

export const radians = (degrees) => (degrees * Math.PI) / 180;
export const degrees = (angle) => (angle * 180) / Math.PI;

/** ln cos(theta_h), precise near the pole and finite on the horizon. */
export function logCos(thetaH) {
  return 0.5 * Math.log1p(-Math.min(Math.sin(thetaH) ** 2, 1 - 2 ** -53));
}

/** Factor g of the azimuthal term `exp(beta g cos(2 phi_d))`. */
export function azimuthalFactor(thetaH, thetaD) {
  const p = Math.sin(thetaH) * Math.sin(thetaD);
  const length = Math.hypot(p, azimuthalWidth * Math.cos(thetaH) * Math.cos(thetaD));
  return length > 0 ? p / length : 0;
}

let latest = { model: null };

/** lnKappa (channel, lobe), and gamma, beta and falloff (lobe) at x = cos(theta_d). */
export function parametersAt(model, x) {
  if (latest.model === model && latest.x === x) return latest;
  const { nLobes, sizes } = model;
  const [scale, gamma, beta, falloff] = SHARED.map((key) => curvesAt(model[key], sizes[key], x));
  const lnKappa = curvesAt(model.colour, sizes.colour, x);
  for (let i = 0; i < lnKappa.length; i++) lnKappa[i] += scale[i % nLobes];
  for (let k = 0; k < nLobes; k++) gamma[k] = Math.exp(gamma[k]);
  latest = { model, x, lnKappa, gamma, beta, falloff };
  return latest;
}

/** Sum of lobes, of which `stretch` gives the azimuthal term of a beta; of one lobe, or of all. */
export function sumOfLobes(model, x, logCosH, stretch, lobe = null) {
  const { nChannels, nLobes } = model;
  const { lnKappa, gamma, beta, falloff } = parametersAt(model, x);
  const values = new Float64Array(nChannels);
  for (let k = lobe ?? 0; k <= (lobe ?? nLobes - 1); k++) {
    const factor = Math.exp(Math.min(falloff[k] * logCosH, maxFactor)) * stretch(beta[k]);
    const power = gamma[k] * logCosH;
    for (let channel = 0; channel < nChannels; channel++) {
      const kappa = Math.exp(Math.min(lnKappa[channel * nLobes + k] + power, maxLnKappa));
      values[channel] += Math.expm1(kappa) * factor;
    }
  }
  return values;
}

/** Values of each channel in 1/sr at angles in radians; cos2Phi is cos(2 phi_d). Of one lobe, or of all. */
export function evaluate(model, thetaH, thetaD, cos2Phi, lobe = null) {
  const azimuth = cos2Phi * azimuthalFactor(thetaH, thetaD);
  return sumOfLobes(model, Math.cos(thetaD), logCos(thetaH), (beta) => Math.exp(beta * azimuth), lobe);
}

/** The mean of `evaluate` over the phi_d at which both directions are above the horizon. */
export function meanOverPhi(model, thetaH, thetaD) {
  const sines = Math.sin(thetaH) * Math.sin(thetaD);
  const least = Math.acos(Math.min(1, (Math.cos(thetaH) * Math.cos(thetaD)) / Math.max(sines, 1e-12)));
  const factor = azimuthalFactor(thetaH, thetaD);
  const azimuths = Array.from(
    { length: N_PHI },
    (_, i) => factor * Math.cos(2 * (least + ((Math.PI / 2 - least) * (i + 0.5)) / N_PHI)),
  );
  const stretch = (beta) => azimuths.reduce((sum, azimuth) => sum + Math.exp(beta * azimuth), 0) / N_PHI;
  return sumOfLobes(model, Math.cos(thetaD), logCos(thetaH), stretch);
}

/** Red, green and blue of values of the channels, none below zero. */
export function asRgb({ rgb }, values) {
  return rgb.map((weights) => {
    let sum = 0;
    for (let c = 0; c < weights.length; c++) sum += weights[c] * values[c];
    return Math.max(sum, 0);
  });
}

export const noEdit = () => ({ on: true, kappa: 1, gamma: 1 });

export function isEdited(edits) {
  return edits.some(({ on, kappa, gamma }) => !on || kappa !== 1 || gamma !== 1);
}

/** The model with its lobes scaled; lobes that are off keep their place. */
export function editedModel(model, edits) {
  if (!isEdited(edits)) return model;
  const { sizes } = model;
  const of = (key, i) => edits[Math.floor(i / sizes[key])];
  return {
    ...model,
    scale: model.scale.map((value, i) => (of("scale", i).on ? value + Math.log(of("scale", i).kappa) : OFF)),
    gamma: model.gamma.map((value, i) => value + Math.log(of("gamma", i).gamma)),
  };
}

/** Rows of `width` numbers, picked. */
function pick(values, rows, width) {
  const picked = new Float32Array(rows.length * width);
  rows.forEach((row, i) => picked.set(values.subarray(row * width, (row + 1) * width), i * width));
  return picked;
}

/** The model with some lobes only, in the given order. */
export function withLobes(model, order) {
  const { nChannels, nLobes, sizes } = model;
  const rows = Array.from({ length: nChannels }, (_, c) => order.map((k) => c * nLobes + k)).flat();
  const shared = SHARED.map((key) => [key, pick(model[key], order, sizes[key])]);
  const colour = pick(model.colour, rows, sizes.colour);
  return { ...model, ...Object.fromEntries(shared), colour, nLobes: order.length };
}

/** The model with some channels only, which may be the same. */
export function withChannels(model, channels) {
  const colour = pick(model.colour, channels, model.nLobes * model.sizes.colour);
  return { ...model, colour, nChannels: channels.length };
}

const IDENTITY = [0, 1, 2].map((i) => [0, 1, 2].map((j) => Number(i === j)));
/** A colour that no display shows has so little of the channel that it would take from others. */
const LEAST_SHARE = 1e-3;
/** Coefficients of heights that add up those of many channels, at least. */
const ENOUGH = 7;

/**
 * The model in red, green and blue. Where these are channels of it, exactly; else the heights of each lobe are those of
 * the channels' sum, and its shape between pole and horizon is near it.
 */
export function inRgb(model) {
  const { rgb } = model;
  const chosen = rgb.map((weights) => (weights.every((w) => w === 0 || w === 1) ? weights.indexOf(1) : -1));
  const shown = { channels: ["r", "g", "b"], rgb: IDENTITY };
  if (!chosen.includes(-1)) return { ...withChannels(model, chosen), ...shown };
  const { nLobes, sizes } = model;
  const rows = Array.from({ length: 3 * nLobes }, () => new Float64Array(PLACES.length));
  PLACES.forEach((x, place) => {
    const { lnKappa } = parametersAt(model, x);
    const pole = lnKappa.map((value) => Math.expm1(Math.exp(Math.min(value, maxLnKappa))));
    for (let k = 0; k < nLobes; k++) {
      const sums = asRgb(model, rgb[0].map((_, c) => pole[c * nLobes + k]));
      const least = Math.max(LEAST_SHARE * Math.max(...sums), 1e-300);
      sums.forEach((sum, i) => (rows[i * nLobes + k][place] = Math.log(Math.log1p(Math.max(sum, least)))));
    }
  });
  const size = Math.max(ENOUGH, sizes.scale, sizes.colour);
  const colour = Float32Array.from(nearestCurves(rows, size));
  const scale = new Float32Array(nLobes * sizes.scale);
  return { ...model, ...shown, nChannels: 3, scale, colour, sizes: { ...sizes, colour: size } };
}

/** A lobe at a few theta_d, to order lobes by. */
function sharpness(model, k) {
  const angles = [10, 30, 50, 70, 85];
  return angles.reduce(
    (sum, angle) => sum + Math.log1p(parametersAt(model, Math.cos(radians(angle))).gamma[k]),
    0,
  );
}

/** Lobes from the flattest to the sharpest, as dsbrdf.space puts them side by side. */
function bySharpness(model) {
  const of = Array.from({ length: model.nLobes }, (_, k) => sharpness(model, k));
  return [...of.keys()].sort((i, j) => of[i] - of[j]);
}

const heightOf = (lnKappa) =>
  Math.log(Math.min(Math.expm1(Math.exp(Math.min(lnKappa, maxLnKappa))), heights[1]) + dark);
const lnKappaOf = (height) =>
  Math.log(Math.log1p(Math.min(Math.max(Math.exp(height) - dark, heights[0]), heights[1])));

/** Coefficients as dsbrdf.space blends them: heights (channel, lobe, coefficient), ln(1 + gamma), beta and falloff. */
function blendable(model, sizes) {
  const of = (key) => resized(model[key], model.sizes[key], sizes[key]);
  const [scale, colour] = [of("scale"), of("colour")];
  const height = colour.map((value, i) => heightOf(value + scale[i % scale.length]));
  const gamma = of("gamma").map((value) => Math.log1p(Math.exp(value)));
  return { height, gamma, beta: of("beta"), falloff: of("falloff") };
}

/**
 * Between two models of the same channels as dsbrdf.space blends them. Lobes stay in the order of `a`; where one model
 * has fewer, a lobe of no height and of the shape of its sharpest is taken.
 */
export function betweenModels(a, b, t) {
  const { nChannels, channels, rgb, falseColours } = a;
  const nLobes = Math.max(a.nLobes, b.nLobes);
  const sizes = Object.fromEntries(SHARED.map((key) => [key, Math.max(a.sizes[key], b.sizes[key])]));
  sizes.scale = sizes.colour = Math.max(sizes.scale, a.sizes.colour, b.sizes.colour);
  const ends = [a, b].map((model) => ({ model, order: bySharpness(model), ...blendable(model, sizes) }));
  const slot = (k) => (k < a.nLobes ? ends[0].order.indexOf(k) : k);
  const lobeOf = ({ order }, k) => order[Math.min(slot(k), order.length - 1)];
  const blend = (value) => (1 - t) * value(ends[0]) + t * value(ends[1]);
  const shape = (key) =>
    Float64Array.from({ length: nLobes * sizes[key] }, (_, i) => {
      const [k, j] = [Math.floor(i / sizes[key]), i % sizes[key]];
      return blend((end) => end[key][lobeOf(end, k) * sizes[key] + j]);
    });
  const lnKappa = Float64Array.from({ length: nChannels * nLobes * sizes.scale }, (_, i) => {
    const [row, j] = [Math.floor(i / sizes.scale), i % sizes.scale];
    const [channel, k] = [Math.floor(row / nLobes), row % nLobes];
    const height = (end) =>
      slot(k) < end.order.length
        ? end.height[(channel * end.model.nLobes + lobeOf(end, k)) * sizes.scale + j]
        : Math.log(dark);
    return lnKappaOf(blend(height));
  });
  const scale = new Float32Array(nLobes * sizes.scale);
  lnKappa.forEach((value, i) => (scale[i % scale.length] += value / nChannels));
  return {
    name: `${Math.round(100 * (1 - t))} % ${a.name}, ${Math.round(100 * t)} % ${b.name}`,
    channels,
    rgb,
    falseColours,
    nChannels,
    nLobes,
    sizes,
    scale,
    gamma: Float32Array.from(shape("gamma"), (value) => Math.log(Math.max(Math.expm1(value), 1e-6))),
    beta: Float32Array.from(shape("beta")),
    falloff: Float32Array.from(shape("falloff")),
    colour: Float32Array.from(lnKappa, (value, i) => value - scale[i % scale.length]),
    profile: null,
  };
}
