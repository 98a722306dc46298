// Kappa, gamma, beta and falloff of each lobe over theta_d.

import { channelNames, lobeColour, lobeDash } from "./channels.js";
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

/** Values over theta_d of a lobe; kappa is that of the chosen channel, or the geometric mean of all. */
function curveOf(points, model, key, lobe) {
  if (key !== "kappa") return points.map((point) => point[key][lobe]);
  const channels = state.channel === null ? [...Array(model.nChannels).keys()] : [state.channel];
  return points.map(({ lnKappa }) => {
    const sum = channels.reduce((total, channel) => total + lnKappa[channel * model.nLobes + lobe], 0);
    return Math.exp(sum / channels.length);
  });
}

function titleOf(model, key) {
  if (key !== "kappa" || model.nChannels === 1) return TITLES[key];
  const of = state.channel === null ? "mean of the channels" : channelNames(model)[state.channel];
  return `${TITLES.kappa}, ${of}`;
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
    const curves = lobes.map((lobe) => curveOf(points, model, key, lobe));
    const scale = parameterScale(key, curves.flat());
    const plot = new Plot(holder, {
      x: linearScale(0, 90, ANGLES, String),
      y: scale,
      xTitle: "θ_d (degrees)",
      yTitle: titleOf(model, key),
      label: `${key} of ${model.nLobes} lobes of ${model.name} over theta_d`,
      margin: SMALL,
    });
    curves.forEach((values, i) => {
      plot.line(AT, values, {
        class: "parameter",
        stroke: lobeColour(lobes[i]),
        "stroke-dasharray": lobeDash(lobes[i]),
        "data-lobe": lobes[i],
      });
    });
    plot.line([state.thetaD, state.thetaD], [scale.from(0), scale.from(1)], { class: "here" });
  }
}
