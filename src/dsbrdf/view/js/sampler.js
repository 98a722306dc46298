// The shares by which the shaders draw directions, as dsbrdf.model.sampling finds them, from fewer nodes.

import { azimuthalFactor, logCos, sumOfLobes } from "./material.js";
import { meta } from "./meta.js";
import { halfAngles, reflected } from "./quadrature.js";

const { powers, nRows, minCosineShare, emSteps, emPower } = meta.constants;
const N_PANELS = 12;
const N_PHI = 8;
/** At 90 degrees nothing is to be seen: look from just above. */
const STEEPEST = (89 * Math.PI) / 180;

const tilts = halfAngles(N_PANELS).map((node) => ({ ...node, logCos: logCos(node.thetaH) }));
/** Densities of half vectors (power, tilt), 1/sr. */
const densities = powers.map((power) =>
  tilts.map((tilt) => ((power + 2) / (2 * Math.PI)) * Math.exp((power + 1) * tilt.logCos)),
);
let rows = null;

/** Pairs of directions of each row that are above the horizon. */
function allNodes() {
  rows ??= Array.from({ length: nRows }, (_, row) =>
    nodesOf(Math.min((0.5 * Math.PI * row) / (nRows - 1), STEEPEST)),
  );
  return rows;
}

/** Half vectors of a direction: where they tilt to, and the factor from their density to one of directions. */
function nodesOf(thetaI) {
  const found = [];
  tilts.forEach(({ thetaH, weight }, tilt) => {
    for (let i = 0; i < N_PHI; i++) {
      const pair = reflected(thetaI, thetaH, (Math.PI * (i + 0.5)) / N_PHI);
      if (!pair) continue;
      const { cosD, cosO, thetaD, cos2Phi } = pair;
      const image = Math.max(2 * Math.cos(thetaH) * Math.cos(thetaI) - cosD, 0);
      found.push({
        tilt,
        cosD: Math.min(cosD, 1),
        azimuth: cos2Phi * azimuthalFactor(thetaH, thetaD),
        toPdf: 0.5 / (cosD + image),
        cosine: cosO / Math.PI,
        weight: (4 * cosD * cosO * weight * 2 * Math.PI) / N_PHI,
      });
    }
  });
  return found;
}

const sumOf = (values) => values.reduce((sum, value) => sum + value, 0);
const scaled = (values, total) => values.map((value) => value / Math.max(total, 1e-300));

/** Share of all light that each node reflects, channels averaged. */
function targetOf(model, nodes) {
  const light = nodes.map(({ tilt, cosD, azimuth, weight }) => {
    const values = sumOfLobes(model, cosD, tilts[tilt].logCos, (beta) => Math.exp(beta * azimuth));
    return sumOf(values) * weight;
  });
  return scaled(light, sumOf(light));
}

/** One step of EM: by how much each share is to grow. */
function growth(shares, nodes, target) {
  const ofTilt = new Float64Array(tilts.length);
  const mixture = tilts.map((_, tilt) => {
    let sum = 0;
    for (let k = 0; k < powers.length; k++) sum += shares[k] * densities[k][tilt];
    return sum;
  });
  let ofCosine = 0;
  nodes.forEach(({ tilt, toPdf, cosine }, i) => {
    const ratio = target[i] / Math.max(mixture[tilt] * toPdf + shares.at(-1) * cosine, 1e-300);
    ofTilt[tilt] += ratio * toPdf;
    ofCosine += ratio * cosine;
  });
  return [
    ...densities.map((density) => density.reduce((sum, x, tilt) => sum + x * ofTilt[tilt], 0)),
    ofCosine,
  ];
}

function sharesOf(nodes, target) {
  let shares = new Array(powers.length + 1).fill(1 / (powers.length + 1));
  for (let step = 0; step < emSteps; step++) {
    const factors = growth(shares, nodes, target);
    shares = shares.map((share, k) => share * (step < 3 ? factors[k] : factors[k] ** emPower));
    shares = scaled(shares, sumOf(shares));
  }
  const rest = sumOf(shares.slice(0, -1));
  const cosine = rest > 0 ? Math.max(1 - rest, minCosineShare) : 1;
  return [...scaled(shares.slice(0, -1), rest).map((share) => share * (1 - cosine)), cosine];
}

/** Shares (row, component) of the powers of a half vector's cosine and of cosine-weighted directions. */
export function samplingShares(model) {
  return allNodes().map((nodes) => sharesOf(nodes, targetOf(model, nodes)));
}
