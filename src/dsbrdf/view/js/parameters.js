// Kappa, gamma, beta and falloff of each lobe over theta_d.

import { lobeColour, lobeDash, shownChannels } from "./channels.js";
import { parametersAt, radians } from "./material.js";
import { linearScale, logBounds, logScale, niceTicks, onResize, Plot } from "./plot.js";
import { currentModel, state, subscribe } from "./state.js";

const ANGLES = [0, 15, 30, 45, 60, 75, 90];
const SMALL = { left: 44, bottom: 38 };
const AT = Array.from({ length: 61 }, (_, i) => 1.5 * i);
const TITLES = {
  kappa: "κ, scale",
  gamma: "γ, shape: narrow is high",
  beta: "β, azimuthal term",
  falloff: "Falloff toward the horizon",
};
const holders = Object.fromEntries(
  Object.keys(TITLES).map((key) => [key, document.getElementById(`${key}-plot`)]),
);

export function startParameters() {
  subscribe(drawParameters);
  onResize(holders.kappa, drawParameters);
}

/** Curves of a lobe, one for gamma, beta and falloff, one for each shown channel for kappa: (curve, theta_d). */
function curvesOf(points, model, key, lobe) {
  if (key !== "kappa") return [points.map((point) => point[key][lobe])];
  return shownChannels(model, state.channel).map((channel) =>
    points.map(({ lnKappa }) => Math.exp(lnKappa[channel * model.nLobes + lobe])),
  );
}

function parameterScale(key, values) {
  if (key === "kappa" || key === "gamma") return logScale(...logBounds(values, 7));
  const room = key === "beta" ? 1 : 0.5;
  const [low, high] = [Math.min(-room, ...values), Math.max(room, ...values)];
  return linearScale(1.05 * low, 1.05 * high, niceTicks(1.05 * low, 1.05 * high));
}

function drawParameters() {
  const model = currentModel();
  const points = AT.map((angle) => parametersAt(model, Math.cos(radians(angle))));
  const lobes = state.edits.flatMap(({ on }, lobe) => (on ? [lobe] : []));
  for (const [key, holder] of Object.entries(holders)) {
    const curves = lobes.map((lobe) => curvesOf(points, model, key, lobe));
    const scale = parameterScale(key, curves.flat(2));
    const plot = new Plot(holder, {
      x: linearScale(0, 90, ANGLES, String),
      y: scale,
      xTitle: "θ_d (degrees)",
      yTitle: TITLES[key],
      label: `${key} of ${model.nLobes} lobes of ${model.name} over theta_d`,
      margin: SMALL,
    });
    curves.forEach((ofLobe, i) => {
      for (const values of ofLobe) {
        plot.line(AT, values, {
          class: `parameter${ofLobe.length > 1 ? " faint" : ""}`,
          stroke: lobeColour(lobes[i]),
          "stroke-dasharray": lobeDash(lobes[i]),
          "data-lobe": lobes[i],
        });
      }
    });
    plot.line([state.thetaD, state.thetaD], [scale.from(0), scale.from(1)], { class: "here" });
  }
}
