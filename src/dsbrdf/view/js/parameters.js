// Kappa, gamma and beta of each lobe over theta_d.

import { lobeColour, lobeMarker, shownChannels } from "./channels.js";
import { degrees } from "./material.js";
import { linearScale, logBounds, logScale, onResize, Plot } from "./plot.js";
import { currentModel, state, subscribe } from "./state.js";

const ANGLES = [0, 15, 30, 45, 60, 75, 90];
const SMALL = { left: 44, bottom: 38 };
const holders = {
  kappa: document.getElementById("kappa-plot"),
  gamma: document.getElementById("gamma-plot"),
  beta: document.getElementById("beta-plot"),
};

export function startParameters() {
  subscribe(drawParameters);
  onResize(holders.kappa, drawParameters);
}

function parameterScale(key, values) {
  if (key === "beta") return linearScale(-1, 1, [-1, -0.5, 0, 0.5, 1]);
  return logScale(...logBounds(values, 7));
}

function drawParameters() {
  const model = currentModel();
  const channels = shownChannels(model, state.channel);
  const at = Array.from(model.thetaD, degrees);
  const titles = { kappa: "κ, scale", gamma: "γ, shape: narrow is high", beta: "β, azimuthal term" };
  for (const [key, holder] of Object.entries(holders)) {
    const shown = model[key].filter((_, i) => state.edits[i % model.nLobes].on);
    const plot = new Plot(holder, {
      x: linearScale(0, 90, ANGLES, String),
      y: parameterScale(key, shown),
      xTitle: "θ_d (degrees)",
      yTitle: titles[key],
      label: `${key} of ${model.nLobes} lobes of ${model.name} over theta_d`,
      margin: SMALL,
    });
    for (let lobe = 0; lobe < model.nLobes; lobe++) {
      if (state.edits[lobe].on)
        channels.forEach((channel) => drawParameter(plot, model, key, lobe, channel, at));
    }
    plot.line([state.thetaD, state.thetaD], key === "beta" ? [-1, 1] : [1e-30, 1e30], { class: "here" });
  }
}

function drawParameter(plot, model, key, lobe, channel, at) {
  const values = at.map((_, slice) => model[key][(slice * model.nChannels + channel) * model.nLobes + lobe]);
  const faint = state.channel === null && model.nChannels > 1 ? " faint" : "";
  plot.line(at, values, { class: `parameter${faint}`, stroke: lobeColour(lobe) });
  if (at.length <= 30) {
    const marks = {
      marker: lobeMarker(lobe),
      size: 2.4,
      class: `mark${faint}`,
      fill: lobeColour(lobe),
      stroke: lobeColour(lobe),
    };
    plot.points(at, values, marks);
  }
}
