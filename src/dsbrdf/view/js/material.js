// Evaluation of a model in JavaScript, as dsbrdf.evaluation does it, and models made from others.

import { meta } from "./data.js";

const { azimuthalWidth, spikeSin2Width, logOffset } = meta.constants;

export const radians = (degrees) => (degrees * Math.PI) / 180;
export const degrees = (angle) => (angle * 180) / Math.PI;

/** ln cos(theta_h), precise near the pole and finite on the horizon. */
export function logCos(thetaH) {
  return 0.5 * Math.log1p(-Math.min(Math.sin(thetaH) ** 2, 1 - 2 ** -53));
}

/** Factor g of the azimuthal term `1 + beta g cos(2 phi_d)`. */
export function azimuthalFactor(thetaH, thetaD) {
  const p = Math.sin(thetaH) * Math.sin(thetaD);
  const length = Math.hypot(p, azimuthalWidth * Math.cos(thetaH) * Math.cos(thetaD));
  return length > 0 ? p / length : 0;
}

/** Slices at or below and above an angle, and the weight of the upper one. */
export function locate(nodes, angle) {
  if (nodes.length === 1 || angle <= nodes[0]) return { low: 0, high: 0, weight: 0 };
  const last = nodes.length - 1;
  if (angle >= nodes[last]) return { low: last, high: last, weight: 0 };
  let low = 0;
  while (nodes[low + 1] <= angle) low++;
  return { low, high: low + 1, weight: (angle - nodes[low]) / (nodes[low + 1] - nodes[low]) };
}

function addSlice(values, weight, model, slice, point, lobe) {
  const { nChannels, nLobes, kappa, gamma, beta, spike } = model;
  for (let channel = 0; channel < nChannels; channel++) {
    const row = (slice * nChannels + channel) * nLobes;
    let sum = lobe === null ? spike[slice * nChannels + channel] * point.cap : 0;
    for (let k = lobe ?? 0; k <= (lobe ?? nLobes - 1); k++) {
      const height = Math.expm1(kappa[row + k] * Math.exp(gamma[row + k] * point.logCos));
      sum += height * (1 + beta[row + k] * point.azimuth);
    }
    values[channel] += weight * sum;
  }
}

/**
 * Values of each channel in 1/sr at angles in radians; of one lobe, or of all and the spike.
 * cos2Phi is cos(2 phi_d); 0 gives the mean over phi_d.
 */
export function evaluate(model, thetaH, thetaD, cos2Phi = 0, lobe = null) {
  const { low, high, weight } = locate(model.thetaD, thetaD);
  const point = {
    logCos: logCos(thetaH),
    azimuth: cos2Phi && cos2Phi * azimuthalFactor(thetaH, thetaD),
    cap: Math.max(0, 1 - Math.sin(thetaH) ** 2 / spikeSin2Width),
  };
  const values = new Float64Array(model.nChannels);
  addSlice(values, 1 - weight, model, low, point, lobe);
  if (weight > 0) addSlice(values, weight, model, high, point, lobe);
  return values;
}

export const noEdit = () => ({ on: true, kappa: 1, gamma: 1 });

export function isEdited(edits, spikeOn = true) {
  return !spikeOn || edits.some(({ on, kappa, gamma }) => !on || kappa !== 1 || gamma !== 1);
}

/** The model with its lobes scaled; lobes that are off keep their place with kappa = 0. */
export function editedModel(model, edits, spikeOn = true) {
  if (!isEdited(edits, spikeOn)) return model;
  const scaled = (values, factor) => values.map((value, i) => value * factor(edits[i % model.nLobes]));
  return {
    ...model,
    kappa: scaled(model.kappa, (edit) => (edit.on ? edit.kappa : 0)),
    gamma: scaled(model.gamma, (edit) => edit.gamma),
    spike: spikeOn ? model.spike : new Float32Array(model.spike.length),
  };
}

/** The model with some lobes only, in the given order; -1 stands for a lobe of no height. */
export function withLobes(model, order) {
  const rows = model.nSlices * model.nChannels;
  const pick = (values, none) => {
    const picked = new Float32Array(rows * order.length);
    for (let i = 0; i < picked.length; i++) {
      const k = order[i % order.length];
      picked[i] = k < 0 ? none : values[Math.floor(i / order.length) * model.nLobes + k];
    }
    return picked;
  };
  return {
    ...model,
    nLobes: order.length,
    kappa: pick(model.kappa, 0),
    gamma: pick(model.gamma, 1),
    beta: pick(model.beta, 0),
  };
}

/** The model's slices at other angles, parameters taken from the nearest. */
function atThetaD(model, thetaD) {
  if (thetaD.length === model.nSlices && thetaD.every((angle, i) => angle === model.thetaD[i])) return model;
  const slices = Array.from(thetaD, (angle) => {
    const { low, high, weight } = locate(model.thetaD, angle);
    return weight < 0.5 ? low : high;
  });
  const pick = (values) => {
    const width = values.length / model.nSlices;
    const picked = new Float32Array(width * slices.length);
    slices.forEach((slice, i) => picked.set(values.subarray(slice * width, (slice + 1) * width), i * width));
    return picked;
  };
  const parameters = Object.fromEntries(
    ["kappa", "gamma", "beta", "spike"].map((key) => [key, pick(model[key])]),
  );
  return { ...model, ...parameters, thetaD, nSlices: thetaD.length };
}

/** Lobes of a channel from the flattest to the sharpest, as dsbrdf.space puts them side by side. */
function bySharpness(model, channel) {
  const sharpness = Array.from({ length: model.nLobes }, (_, k) => {
    let sum = 0;
    for (let slice = 0; slice < model.nSlices; slice++) {
      sum += Math.log1p(model.gamma[(slice * model.nChannels + channel) * model.nLobes + k]);
    }
    return sum;
  });
  return [...sharpness.keys()].sort((i, j) => sharpness[i] - sharpness[j]);
}

/** Where to read lobe `k` of a channel of `a`, and its counterpart in `b`; `none` where there is no such lobe. */
function counterparts(a, b, channel, k) {
  const [orderA, orderB] = [bySharpness(a, channel), bySharpness(b, channel)];
  const slot = k < a.nLobes ? orderA.indexOf(k) : k;
  const place = (order, at) => ({ lobe: order[Math.min(at, order.length - 1)], none: at >= order.length });
  return [place(orderA, slot), place(orderB, slot)];
}

/**
 * Between two models of the same channels as dsbrdf.space blends them, slice by slice: logarithms of kappa and gamma,
 * the other parameters as they are. Lobes stay in the order of `a`; where one model has fewer, a lobe of no height and of the shape of its sharpest is taken.
 */
export function betweenModels(a, b, t) {
  const nLobes = Math.max(a.nLobes, b.nLobes);
  const { nSlices, nChannels, thetaD } = a;
  b = atThetaD(b, thetaD);
  const blend = (x, y) => (1 - t) * x + t * y;
  const blendLog = (x, y, offset) =>
    Math.max(0, Math.exp(blend(Math.log(x + offset), Math.log(y + offset))) - offset);
  const mixed = Object.fromEntries(
    ["kappa", "gamma", "beta"].map((key) => [key, new Float32Array(nSlices * nChannels * nLobes)]),
  );
  for (let channel = 0; channel < nChannels; channel++) {
    for (let k = 0; k < nLobes; k++) {
      const [inA, inB] = counterparts(a, b, channel, k);
      for (let slice = 0; slice < nSlices; slice++) {
        const row = slice * nChannels + channel;
        const [i, j] = [row * a.nLobes + inA.lobe, row * b.nLobes + inB.lobe];
        const kappas = [inA.none ? 0 : a.kappa[i], inB.none ? 0 : b.kappa[j]];
        mixed.kappa[row * nLobes + k] = blendLog(...kappas, logOffset);
        mixed.gamma[row * nLobes + k] = blendLog(a.gamma[i], b.gamma[j], 1);
        mixed.beta[row * nLobes + k] = blend(a.beta[i], b.beta[j]);
      }
    }
  }
  const spike = a.spike.map((height, i) => blend(height, b.spike[i]));
  const name = `${Math.round(100 * (1 - t))} % ${a.name}, ${Math.round(100 * t)} % ${b.name}`;
  return { name, thetaD, nSlices, nChannels, nLobes, ...mixed, spike, profile: null };
}
