// Directional albedo by quadrature over the half vector, as dsbrdf.sampling does it, and its plot over theta_i.

import { channelColour, channelNames, shownChannels } from "./channels.js";
import { evaluate, radians } from "./material.js";
import { formatNumber, linearScale, onResize, Plot } from "./plot.js";
import { altersModel, currentModel, state, subscribe } from "./state.js";

const ANGLES = [0, 15, 30, 45, 60, 75, 90];
const AT = [...Array.from({ length: 18 }, (_, i) => 5 * i), 88];
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

const LEGENDRE = [
  [-0.8611363115940526, 0.3478548451374539],
  [-0.3399810435848563, 0.6521451548625461],
  [0.3399810435848563, 0.6521451548625461],
  [0.8611363115940526, 0.3478548451374539],
];

/** Nodes and weights over theta_h: panels shrink toward the pole, so that lobes of any width are met. */
const halfAngles = (() => {
  const edges = [0, ...Array.from({ length: 20 }, (_, i) => 1e-4 * (5000 * Math.PI) ** (i / 19))];
  return edges.slice(1).flatMap((high, i) => {
    const width = high - edges[i];
    return LEGENDRE.map(([node, weight]) => {
      const thetaH = edges[i] + 0.5 * width * (node + 1);
      return { thetaH, weight: 0.5 * width * weight * Math.sin(thetaH) };
    });
  });
})();

/** Share of light from `thetaI` (radians) that is reflected, for each channel; `nPhi` azimuths of the half vector. */
export function albedo(model, thetaI, nPhi = 24) {
  const total = new Float64Array(model.nChannels);
  for (const { thetaH, weight } of halfAngles) {
    for (let i = 0; i < nPhi; i++) {
      // wi in the x-z plane; symmetric, so half of the azimuths do
      const cosPhi = Math.cos((Math.PI * (i + 0.5)) / nPhi);
      const cosD = Math.sin(thetaH) * cosPhi * Math.sin(thetaI) + Math.cos(thetaH) * Math.cos(thetaI);
      const cosO = 2 * cosD * Math.cos(thetaH) - Math.cos(thetaI);
      if (cosD <= 0 || cosO <= 0) continue;
      const thetaD = Math.acos(Math.min(cosD, 1));
      const sines = Math.sin(thetaH) * Math.sin(thetaD);
      const cosPhiD = sines > 1e-12 ? (Math.cos(thetaH) * cosD - Math.cos(thetaI)) / sines : 0;
      const cos2Phi = 2 * Math.min(1, cosPhiD * cosPhiD) - 1;
      const factor = (weight * 4 * cosD * cosO * 2 * Math.PI) / nPhi;
      evaluate(model, thetaH, thetaD, cos2Phi).forEach((value, c) => (total[c] += factor * value));
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
