// The theta_h x theta_d image slice: measured, fitted and their difference.

import { asRgb, degrees, meanOverPhi } from "./material.js";
import { formatNumber, withSubscripts } from "./plot.js";
import { altersModel, baseModel, currentModel, setState, state, subscribe } from "./state.js";

/** Cells across, and while something is dragged, until nothing has changed for some ms. */
const SIZE = 90;
const COARSE = 30;
const REST = 150;
const RIGHT = Math.PI / 2;
/** Relative difference at which the scale of colours ends. */
const FULL_DIFFERENCE = 0.2;
/** Opacity of what was not measured; the background of the panel shows through. */
const VEILED = 0.3;
const BLUE = [33, 102, 172];
const RED = [178, 24, 43];

const figures = Object.fromEntries(
  ["measured", "fitted", "difference"].map((kind) => [kind, document.getElementById(`slice-${kind}`)]),
);
const readout = document.getElementById("slice-readout");
let latest = -Infinity;
let rest = 0;

export function startImageSlice() {
  subscribe(showSlices);
  for (const [kind, canvas] of Object.entries(figures)) {
    canvas.addEventListener("pointermove", (event) => showCell(kind, event));
    canvas.addEventListener("pointerleave", () => (readout.textContent = ""));
    canvas.addEventListener("click", (event) =>
      setState({ thetaD: Math.round(degrees(cellAngles(canvas, event).thetaD)) }),
    );
  }
}

const columnAngle = (column, size) => RIGHT * ((column + 0.5) / size) ** 2;
const rowAngle = (row, size) => RIGHT * (1 - (row + 0.5) / size);

function cellAngles(canvas, event) {
  const box = canvas.getBoundingClientRect();
  const x = (event.clientX - box.left) / box.width;
  const y = (event.clientY - box.top) / box.height;
  return {
    thetaH: RIGHT * Math.min(Math.max(x, 0), 1) ** 2,
    thetaD: RIGHT * Math.min(Math.max(1 - y, 0), 1),
  };
}

/** Mean over phi_d measured nearest to angles, for each channel; null where nothing is. */
export function measuredAt(profile, thetaH, thetaD) {
  const slice = nearest(profile.thetaD, 0, profile.nSlices, thetaD);
  const row = profile.thetaHRows > 1 ? slice * profile.nThetaH : 0;
  const cell = nearest(profile.thetaH, row, profile.nThetaH, thetaH);
  const values = Array.from(
    { length: profile.nChannels },
    (_, channel) => profile.mean[(slice * profile.nChannels + channel) * profile.nThetaH + cell],
  );
  if (!values.every(Number.isFinite)) return null;
  const angles = { thetaH: profile.thetaH[row + cell], thetaD: profile.thetaD[slice] };
  return { values, ...angles, cell: slice * profile.nThetaH + cell };
}

function nearest(nodes, offset, count, angle) {
  let [low, high] = [0, count - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (nodes[offset + middle] <= angle) low = middle;
    else high = middle;
  }
  return angle - nodes[offset + low] < nodes[offset + high] - angle ? low : high;
}

/** sRGB of a reflectance, a perfect diffuser being white at exposure 0. */
function displayColour(model, values) {
  return asRgb(model, values).map(
    (value) => 255 * Math.min(1, Math.max(0, Math.PI * value * 2 ** state.exposure)) ** (1 / 2.2),
  );
}

function differenceColour(measured, fitted) {
  const sum = (values) => values.reduce((total, value) => total + value, 0);
  const relative = (sum(fitted) - sum(measured)) / Math.max(sum(measured), 1e-9);
  const share = Math.min(1, Math.abs(relative) / FULL_DIFFERENCE);
  return (relative > 0 ? RED : BLUE).map((full) => 247 + share * (full - 247));
}

function showSlices(changed) {
  if (altersModel(changed) || changed.has("exposure")) {
    const now = performance.now();
    const isOne = now - latest > REST;
    clearTimeout(rest);
    if (!isOne) rest = setTimeout(() => drawSlices(SIZE), REST);
    drawSlices(isOne ? SIZE : COARSE);
    latest = performance.now();
  }
  for (const canvas of Object.values(figures)) {
    canvas.parentElement.style.setProperty("--here", `${100 * (1 - state.thetaD / 90)}%`);
  }
}

function drawSlices(size) {
  const model = currentModel();
  const { profile } = baseModel();
  const images = Object.fromEntries(Object.keys(figures).map((kind) => [kind, new ImageData(size, size)]));
  const differences = new Map();
  for (let row = 0; row < size; row++) {
    for (let column = 0; column < size; column++) {
      const [thetaH, thetaD] = [columnAngle(column, size), rowAngle(row, size)];
      const put = (kind, colour, opacity = 1) =>
        images[kind].data.set([...colour, 255 * opacity], 4 * (row * size + column));
      const measured = profile && measuredAt(profile, thetaH, thetaD);
      put(
        "fitted",
        displayColour(model, meanOverPhi(model, thetaH, thetaD)),
        profile && !measured ? VEILED : 1,
      );
      if (!measured) continue;
      put("measured", displayColour(model, measured.values));
      const { cell } = measured;
      if (!differences.has(cell)) {
        const fitted = meanOverPhi(model, measured.thetaH, measured.thetaD);
        differences.set(cell, differenceColour(measured.values, fitted));
      }
      put("difference", differences.get(cell));
    }
  }
  for (const [kind, canvas] of Object.entries(figures)) {
    canvas.width = canvas.height = size;
    canvas.getContext("2d").putImageData(images[kind], 0, 0);
    canvas.closest("figure").hidden = kind !== "fitted" && !profile;
  }
  const caption = figures.fitted.closest("figure").querySelector("figcaption");
  caption.textContent = profile ? "Fitted. Veiled: not measured." : "Model";
}

function showCell(kind, event) {
  const { thetaH, thetaD } = cellAngles(figures[kind], event);
  const { profile } = baseModel();
  const measured = profile && measuredAt(profile, thetaH, thetaD);
  const model = currentModel();
  const format = (values) =>
    asRgb(model, values)
      .map((value) => formatNumber(value))
      .join(", ");
  const parts = [`θ_h ${formatNumber(degrees(thetaH))}°, θ_d ${formatNumber(degrees(thetaD))}°`];
  if (measured) parts.push(`measured ${format(measured.values)}`);
  parts.push(`${profile ? "fitted" : "model"} ${format(meanOverPhi(model, thetaH, thetaD))} /sr`);
  readout.replaceChildren(...withSubscripts(parts.join(" · ")));
}
