// The table of lobes: on and off, solo, and sliders that scale kappa and gamma.

import { lineSample, lobeColour, lobeDash } from "./channels.js";
import { components } from "./components.js";
import { degrees, isEdited, noEdit, parametersAt, radians } from "./material.js";
import { formatNumber, html } from "./plot.js";
import { altersModel, baseModel, currentModel, editLobe, setState, state, subscribe } from "./state.js";

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
    if (altersModel(changed)) showComponents();
  });
}

function resetLobes() {
  setState({ edits: state.edits.map(noEdit) });
}

function buildRows() {
  rows = state.edits.map((_, lobe) => lobeRow(lobe));
  table.replaceChildren(...rows.map((row) => row.node));
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
  const about = html("p", { className: "note about" });
  const node = html("li", { className: "lobe-row" }, name, solo, about);
  node.append(html("div", { className: "factors" }, ...sliders.map((slider) => slider.node)));
  return { node, on, solo, sliders, about };
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

/** This lobe alone; all of them, where it is alone already. */
function toggleSolo(lobe) {
  const alone = isSolo(lobe);
  setState({ edits: state.edits.map((edit, k) => ({ ...edit, on: alone || k === lobe })) });
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
  document.getElementById("reset").disabled = !isEdited(state.edits);
  showNumbers();
}

/** What each lobe is, its share of the light, and how wide it is. */
function showComponents() {
  components(currentModel()).forEach(({ share, width, label }, lobe) => {
    const parts = [
      label,
      `${(100 * share).toFixed(1)} % of the light`,
      `half width ${formatNumber(degrees(width), 2)}°`,
    ];
    rows[lobe].about.textContent = state.edits[lobe].on ? parts.join(" · ") : "off";
  });
}

/** Kappa of each channel and gamma at the theta_d on show, in the titles of the sliders. */
function showNumbers() {
  const model = currentModel();
  const { lnKappa, gamma } = parametersAt(model, Math.cos(radians(state.thetaD)));
  rows.forEach(({ sliders }, lobe) => {
    const kappas = Array.from({ length: model.nChannels }, (_, c) =>
      Math.exp(lnKappa[c * model.nLobes + lobe]),
    );
    const values = { kappa: kappas, gamma: [gamma[lobe]] };
    for (const { key, range } of sliders) {
      range.title = `${SYMBOLS[key]} here: ${values[key].map((value) => formatNumber(value)).join(", ")}`;
    }
  });
}
