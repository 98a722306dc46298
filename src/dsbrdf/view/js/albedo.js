// Directional albedo by quadrature over the half vector, as dsbrdf.model.energy does it, and its plot over theta_i.

import { channelColour, channelNames, shownChannels } from "./channels.js";
import { evaluate, radians } from "./material.js";
import { formatNumber, linearScale, onResize, Plot } from "./plot.js";
import { halfAngles, reflected } from "./quadrature.js";
import { altersModel, currentModel, state, subscribe } from "./state.js";

const ANGLES = [0, 15, 30, 45, 60, 75, 90];
const AT = [...Array.from({ length: 18 }, (_, i) => 5 * i), 88];
const NODES = halfAngles(20);
/** Milliseconds without a change before it is computed anew. */
const PAUSE = 80;
const holder = document.getElementById("albedo-plot");
let timer = 0;

export function startAlbedo() {
  subscribe((changed) => {
    if (!altersModel(changed) && !changed.has("channel")) return;
    clearTimeout(timer);
    timer = setTimeout(drawAlbedo, PAUSE);
  });
  onResize(holder, drawAlbedo);
}

/** Share of light from `thetaI` (radians) that is reflected, for each channel, by one lobe or all. */
export function albedo(model, thetaI, nPhi = 24, lobe = null) {
  const total = new Float64Array(model.nChannels);
  for (const { thetaH, weight } of NODES) {
    for (let i = 0; i < nPhi; i++) {
      const pair = reflected(thetaI, thetaH, (Math.PI * (i + 0.5)) / nPhi);
      if (!pair) continue;
      const factor = (weight * 4 * pair.cosD * pair.cosO * 2 * Math.PI) / nPhi;
      const values = evaluate(model, thetaH, pair.thetaD, pair.cos2Phi, lobe);
      values.forEach((value, c) => (total[c] += factor * value));
    }
  }
  return total;
}

function drawAlbedo() {
  const model = currentModel();
  const values = AT.map((angle) => albedo(model, radians(angle)));
  const top = Math.max(1, ...values.map((value) => Math.max(...value)));
  const plot = new Plot(holder, {
    x: linearScale(0, 90, ANGLES, String),
    y: linearScale(0, 1.04 * Math.min(top, 5)),
    xTitle: "θ_i (degrees)",
    yTitle: "Albedo (share of the light reflected)",
    label: `Directional albedo of ${model.name}; at normal incidence ${Array.from(values[0], (v) => formatNumber(v)).join(", ")}`,
    margin: { left: 44, bottom: 38 },
  });
  plot.line([0, 90], [1, 1], { class: "limit" });
  for (const channel of shownChannels(model, state.channel)) {
    const curve = values.map((value) => value[channel]);
    const title = channelNames(model)[channel];
    plot.line(AT, curve, { class: "fitted", stroke: channelColour(model, channel), "data-channel": title });
  }
  const note = document.getElementById("albedo-note");
  note.textContent =
    top > 1.005 ? "Above 1: more light leaves than arrives. Nothing in the model forbids it." : "";
}
