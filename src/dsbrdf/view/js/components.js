// What the lobes of a model are, as dsbrdf.model.components says it.

import { albedo } from "./albedo.js";
import { parametersAt } from "./material.js";
import { meta } from "./meta.js";

const { widths } = meta.constants;
const N_PHI = 8;

/** ln(expm1(x)) without overflow. */
const lnExpm1 = (x) => (x > 1 ? x + Math.log1p(-Math.exp(-x)) : Math.log(Math.max(Math.expm1(x), 1e-300)));

/** theta_h in radians at which a lobe is half its height, by halving in -ln cos(theta_h). */
export function halfWidth(kappa, gamma, falloff) {
  let [low, high] = [0, 40];
  for (let i = 0; i < 60; i++) {
    const middle = low > 0 ? Math.sqrt(low * high) : 1e-3 * high;
    const height = lnExpm1(kappa * Math.exp(-gamma * middle)) - falloff * middle;
    if (height > lnExpm1(kappa) - Math.LN2) low = middle;
    else high = middle;
  }
  return high >= 39 ? Math.PI / 2 : Math.atan(Math.sqrt(Math.expm1(2 * high)));
}

const labelOf = (width) => Object.keys(widths).find((label) => width < widths[label]) ?? "body";

/** Of each lobe its share of the light at normal incidence, its half width in radians, and what it is called. */
export function components(model) {
  const { nChannels, nLobes } = model;
  const sum = (values) => values.reduce((total, value) => total + value, 0);
  const albedos = Array.from({ length: nLobes }, (_, k) => albedo(model, 0, N_PHI, k));
  const all = sum(albedos.map(sum));
  const { lnKappa, gamma, falloff } = parametersAt(model, 1);
  return albedos.map((light, k) => {
    const weights = sum(light) > 0 ? light : light.map(() => 1);
    const ofChannels = Array.from({ length: nChannels }, (_, c) =>
      halfWidth(Math.exp(lnKappa[c * nLobes + k]), gamma[k], falloff[k]),
    );
    const width = sum(ofChannels.map((value, c) => value * weights[c])) / sum(weights);
    return { share: sum(light) / Math.max(all, 1e-300), width, label: labelOf(width) };
  });
}
