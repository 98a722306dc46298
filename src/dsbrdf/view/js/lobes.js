// The table of lobes: on and off, solo, and sliders that scale kappa and gamma.

import { lineSample, lobeColour, lobeDash } from "./channels.js";
import { isEdited, noEdit, radians, locate } from "./material.js";
import { formatNumber, html } from "./plot.js";
import { baseModel, editLobe, setState, state, subscribe } from "./state.js";

/** Sliders go from 1/FACTOR to FACTOR. */
const FACTORS = { kappa: 2, gamma: 10 };
const SYMBOLS = { kappa: "κ", gamma: "γ" };
const table = document.getElementById("lobes");
let rows = [];

export function startLobes() {
  document.getElementById("reset").addEventListener("click", resetLobes);
  subscribe((changed) => {
    if (rows.length !== baseModel().nLobes || changed.has("material")) buildRows();
    showRows();
  });
}

function resetLobes() {
  setState({ edits: state.edits.map(noEdit), spikeOn: true });
}

function buildRows() {
  const model = baseModel();
  rows = state.edits.map((_, lobe) => lobeRow(lobe));
  const hasSpike = model.spike.some((height) => height > 0);
  table.replaceChildren(...rows.map((row) => row.node), ...(hasSpike ? [spikeRow()] : []));
}

function lobeRow(lobe) {
  const on = html("input", {
    type: "checkbox",
    id: `lobe-${lobe}`,
    onchange: () => editLobe(lobe, { on: on.checked }),
  });
  const name = html(
    "label",
    { for: `lobe-${lobe}`, className: "lobe-name" },
    on,
    lineSample(lobeColour(lobe), { dash: lobeDash(lobe) }),
    `Lobe ${lobe}`,
  );
  const solo = html(
    "button",
    { type: "button", className: "small", onclick: () => toggleSolo(lobe) },
    "Solo",
  );
  solo.setAttribute("aria-label", `Solo lobe ${lobe}`);
  const sliders = Object.keys(FACTORS).map((key) => factorSlider(lobe, key));
  const node = html("li", { className: "lobe-row" }, name, solo);
  node.append(html("div", { className: "factors" }, ...sliders.map((slider) => slider.node)));
  return { node, on, solo, sliders };
}

function factorSlider(lobe, key) {
  const limit = Math.log2(FACTORS[key]);
  const id = `${key}-${lobe}`;
  const range = html("input", { type: "range", id, min: -limit, max: limit, step: limit / 50, value: 0 });
  range.addEventListener("input", () => editLobe(lobe, { [key]: 2 ** range.valueAsNumber }));
  range.addEventListener("dblclick", () => editLobe(lobe, { [key]: 1 }));
  const output = html("output", { for: id });
  const label = html("label", { for: id }, SYMBOLS[key]);
  label.setAttribute("aria-label", `${key} of lobe ${lobe}, factor`);
  range.setAttribute("aria-label", `${key} of lobe ${lobe}, factor`);
  return { key, range, output, node: html("div", { className: "factor" }, label, range, output) };
}

function spikeRow() {
  const on = html("input", {
    type: "checkbox",
    id: "spike",
    onchange: () => setState({ spikeOn: on.checked }),
  });
  on.checked = state.spikeOn;
  const label = html("label", { for: "spike", className: "lobe-name" }, on, "Spike");
  return html(
    "li",
    { className: "lobe-row" },
    label,
    html("span", { className: "note" }, "light within 1° of the mirror direction"),
  );
}

/** This lobe alone; all of them, where it is alone already. */
function toggleSolo(lobe) {
  const alone = isSolo(lobe);
  setState({ edits: state.edits.map((edit, k) => ({ ...edit, on: alone || k === lobe })), spikeOn: alone });
}

const isSolo = (lobe) => state.edits.length > 1 && state.edits.every((edit, k) => edit.on === (k === lobe));

function showRows() {
  rows.forEach(({ on, solo, sliders, node }, lobe) => {
    const edit = state.edits[lobe];
    on.checked = edit.on;
    node.classList.toggle("off", !edit.on);
    solo.setAttribute("aria-pressed", isSolo(lobe));
    solo.hidden = rows.length === 1;
    for (const { key, range, output } of sliders) {
      range.valueAsNumber = Math.log2(edit[key]);
      range.setAttribute("aria-valuetext", `times ${formatNumber(edit[key])}`);
      output.textContent = `×${edit[key].toFixed(2)}`;
    }
  });
  const spike = document.getElementById("spike");
  if (spike) spike.checked = state.spikeOn;
  document.getElementById("reset").disabled = !isEdited(state.edits, state.spikeOn);
  showNumbers();
}

/** Kappa and gamma at the theta_d on show, mean of channels, in the titles of the sliders. */
function showNumbers() {
  const model = baseModel();
  const { low, high, weight } = locate(model.thetaD, radians(state.thetaD));
  const slice = weight < 0.5 ? low : high;
  rows.forEach(({ sliders }, lobe) => {
    for (const { key, range } of sliders) {
      const values = Array.from(
        { length: model.nChannels },
        (_, c) => model[key][(slice * model.nChannels + c) * model.nLobes + lobe],
      );
      range.title = `${SYMBOLS[key]} here: ${values.map((value) => formatNumber(value * state.edits[lobe][key])).join(", ")}`;
    }
  });
}
