// Measured points and fitted curves over theta_h at one theta_d, across and along the plane of incidence.

import {
  channelColour,
  channelNames,
  lineSample,
  lobeColour,
  lobeDash,
  pointSample,
  shownChannels,
} from "./channels.js";
import { degrees, evaluate, radians } from "./material.js";
import {
  formatNumber,
  html,
  linearScale,
  logBounds,
  logScale,
  onResize,
  Plot,
  rootScale,
  withSubscripts,
} from "./plot.js";
import { baseModel, currentModel, setState, state, subscribe } from "./state.js";

const TICKS = [-90, -60, -30, -10, 0, 10, 30, 60, 90];
const N_POINTS = 160;
/** theta_h in degrees above which values do not set the scale: some lobes rise without end toward the horizon. */
const STEEP = 88;
// Denser at the pole, where peaks are
const THETA_H = Array.from({ length: N_POINTS + 1 }, (_, i) => (Math.PI / 2) * (i / N_POINTS) ** 2);

const holder = document.getElementById("curves-plot");
const readout = document.getElementById("curves-readout");
let plot = null;

/** Signed theta_h in degrees (left phi_d = 90, right phi_d = 0) and values (point, channel) of a model. */
export function incidentPlane(model, thetaD, lobe = null) {
  const across = THETA_H.map((thetaH) => evaluate(model, thetaH, thetaD, -1, lobe));
  const along = THETA_H.map((thetaH) =>
    thetaH + thetaD < Math.PI / 2
      ? evaluate(model, thetaH, thetaD, 1, lobe)
      : evaluate(model, thetaH, thetaD, 1, lobe).fill(NaN),
  );
  const angles = [...THETA_H.map((angle) => -degrees(angle)).reverse(), ...THETA_H.map(degrees)];
  return { angles, values: [...across.reverse(), ...along] };
}

/** The measured slice nearest to theta_d, as `incidentPlane` gives it. */
export function measuredPlane(profile, thetaD) {
  let slice = 0;
  profile.thetaD.forEach((angle, i) => {
    if (Math.abs(angle - thetaD) < Math.abs(profile.thetaD[slice] - thetaD)) slice = i;
  });
  const { nThetaH, nChannels, thetaHRows, mean, amplitude } = profile;
  const thetaH = Array.from(
    { length: nThetaH },
    (_, i) => profile.thetaH[(thetaHRows > 1 ? slice * nThetaH : 0) + i],
  );
  const at = (i, sign) =>
    Array.from({ length: nChannels }, (_, channel) => {
      const cell = (slice * nChannels + channel) * nThetaH + i;
      const isSeen = sign < 0 || thetaH[i] + profile.thetaD[slice] < Math.PI / 2;
      return isSeen ? mean[cell] + sign * amplitude[cell] : NaN;
    });
  const angles = [...thetaH.map((angle) => -degrees(angle)).reverse(), ...thetaH.map(degrees)];
  const values = [...thetaH.map((_, i) => at(i, -1)).reverse(), ...thetaH.map((_, i) => at(i, 1))];
  return { thetaD: profile.thetaD[slice], angles, values };
}

function verticalScale(curves, measured, other) {
  const numbers = ({ angles, values }) =>
    values
      .flatMap((point, i) => (Math.abs(angles[i]) < STEEP ? [...point] : []))
      .filter((value) => value > 0);
  const fitted = numbers(curves);
  const seen = measured ? [...numbers(measured), Math.max(...fitted)] : fitted;
  if (other) seen.push(Math.max(...numbers(other)));
  if (state.log) return logScale(...logBounds(seen));
  return linearScale(0, 1.06 * Math.max(1e-9, ...seen, ...fitted));
}

function drawLobes(model, thetaD, channels) {
  for (let lobe = 0; lobe < model.nLobes; lobe++) {
    if (!state.edits[lobe].on) continue;
    const { angles, values } = incidentPlane(model, thetaD, lobe);
    const mean = values.map(
      (point) => channels.reduce((sum, channel) => sum + point[channel], 0) / channels.length,
    );
    plot.line(angles, mean, {
      class: "lobe",
      stroke: lobeColour(lobe),
      "stroke-dasharray": lobeDash(lobe),
      "data-lobe": lobe,
    });
  }
}

function drawOther(model, { angles, values }, channels) {
  for (const channel of channels.filter((c) => c < model.nChannels)) {
    plot.line(
      angles,
      values.map((point) => point[channel]),
      { class: "other", stroke: channelColour(model, channel) },
    );
  }
}

let secondModel = () => null;

/** `second` gives the material that is compared with. */
export function startCurves(second) {
  secondModel = second;
  const slider = document.getElementById("theta-d");
  slider.addEventListener("input", () => setState({ thetaD: slider.valueAsNumber }));
  for (const radio of document.querySelectorAll("input[name=scale]")) {
    radio.addEventListener("change", () => setState({ log: radio.value === "log" }));
  }
  subscribe(drawCurves);
  onResize(holder, drawCurves);
  holder.addEventListener("pointermove", showValues);
  holder.addEventListener("pointerleave", () => (readout.textContent = ""));
}

function drawCurves() {
  const model = currentModel();
  const thetaD = radians(state.thetaD);
  const channels = shownChannels(model, state.channel);
  const curves = incidentPlane(model, thetaD);
  const profile = baseModel().profile;
  const measured = profile && measuredPlane(profile, thetaD);
  const second = state.compare === "second" ? secondModel() : null;
  const other = second && incidentPlane(second, thetaD);
  plot = new Plot(holder, {
    x: rootScale(-90, 90, TICKS),
    y: verticalScale(curves, measured, other),
    xTitle: "φ_d = 90°  ←  θ_h (degrees)  →  φ_d = 0°",
    yTitle: "BRDF (1/sr)",
    label: curvesLabel(model, curves, channels),
  });
  if (measured) {
    for (const channel of channels) {
      const values = measured.values.map((point) => point[channel]);
      plot.points(measured.angles, values, {
        class: "measured",
        stroke: channelColour(model, channel),
        size: 2.6,
        apart: 6,
      });
    }
  }
  if (second) drawOther(second, other, channels);
  for (const channel of channels) {
    const values = curves.values.map((point) => point[channel]);
    plot.line(curves.angles, values, {
      class: "fitted",
      stroke: channelColour(model, channel),
      "data-channel": channel,
    });
  }
  drawLobes(model, thetaD, channels);
  showControls(measured);
  drawLegend(model, channels, measured, second);
}

function showControls(measured) {
  const slider = document.getElementById("theta-d");
  slider.valueAsNumber = state.thetaD;
  slider.setAttribute("aria-valuetext", `${state.thetaD} degrees`);
  document.getElementById("theta-d-value").textContent = `${formatNumber(state.thetaD)}°`;
  document.querySelector(`input[name=scale][value=${state.log ? "log" : "linear"}]`).checked = true;
  const note = document.getElementById("curves-note");
  const text = measured
    ? `Squares: measured at θ_d = ${formatNumber(degrees(measured.thetaD))}°, the mean over φ_d ± the amplitude of cos 2φ_d.`
    : "This model carries no summary of what was measured.";
  const lobes =
    state.channel === null && baseModel().nChannels > 1
      ? " Dashed: lobes, mean of the channels."
      : " Dashed: lobes.";
  note.replaceChildren(...withSubscripts(text + lobes));
}

function curvesLabel(model, { angles, values }, channels) {
  const pole = values[angles.length / 2];
  const heights = channels.map((c) => `${channelNames(model)[c]} ${formatNumber(pole[c])}`).join(", ");
  return `${model.name}: reflectance over theta_h at theta_d ${formatNumber(state.thetaD)} degrees. At theta_h 0, in 1/sr: ${heights}.`;
}

function drawLegend(model, channels, measured, second) {
  const entry = (sample, text) => html("li", {}, sample, text);
  const entries = channels.map((c) => entry(lineSample(channelColour(model, c)), channelNames(model)[c]));
  if (measured) entries.push(entry(pointSample("var(--muted)"), "measured"));
  if (second) entries.push(entry(lineSample("var(--muted)", { width: 1 }), second.name));
  for (let lobe = 0; lobe < model.nLobes; lobe++) {
    if (state.edits[lobe].on)
      entries.push(entry(lineSample(lobeColour(lobe), { dash: lobeDash(lobe) }), `lobe ${lobe}`));
  }
  document.getElementById("curves-legend").replaceChildren(...entries);
}

function showValues(event) {
  const at = (event.offsetX - plot.box.left) / plot.box.width;
  if (at < 0 || at > 1) return;
  const angle = plot.scales.x.from(at);
  const model = currentModel();
  const values = evaluate(model, radians(Math.abs(angle)), radians(state.thetaD), angle < 0 ? -1 : 1);
  const names = channelNames(model);
  const text = shownChannels(model, state.channel).map((c) => `${names[c]} ${formatNumber(values[c])}`);
  const where = `θ_h ${formatNumber(Math.abs(angle))}°, φ_d ${angle < 0 ? 90 : 0}°: `;
  readout.replaceChildren(...withSubscripts(where), `${text.join(", ")} /sr`);
}
