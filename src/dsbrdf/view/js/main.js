// Put the page together.

import { albedo, startAlbedo } from "./albedo.js";
import { bakedGlsl } from "./baked_glsl.js";
import { channelNames } from "./channels.js";
import { startCurves } from "./curves.js";
import { indexOfMaterial, materials, meta } from "./data.js";
import { startDownloads } from "./download.js";
import { startImageSlice } from "./image_slice.js";
import { startLobes } from "./lobes.js";
import { startMap } from "./map.js";
import { startParameters } from "./parameters.js";
import { evaluate } from "./material.js";
import { formatNumber, html } from "./plot.js";
import { startSelection } from "./selection.js";
import { startSphere } from "./sphere_panel.js";
import { baseModel, currentModel, readFragment, setState, state, subscribe } from "./state.js";

const materialSelect = document.getElementById("material");
const channels = document.getElementById("channels");

function startHeader() {
  materialSelect.append(...materials.map(({ name }) => html("option", { value: name }, name)));
  materialSelect.addEventListener("change", () =>
    setState({ material: indexOfMaterial(materialSelect.value) }),
  );
  subscribe(showHeader);
  document.getElementById("theme").addEventListener("click", switchTheme);
}

function showHeader(changed) {
  const model = baseModel();
  materialSelect.value = materials[state.material].name;
  document.title = `${model.name} · dsbrdf`;
  const count = (number, word) => `${number} ${word}${number === 1 ? "" : "s"}`;
  const facts = [
    count(model.nLobes, "lobe"),
    count(model.nSlices, "slice"),
    count(model.nChannels, "channel"),
  ];
  const { rel_rms: error, monotone_floor: floor } = model.errors ?? {};
  if (Number.isFinite(error)) facts.push(`relative RMS error ${formatNumber(100 * error)} %`);
  if (Number.isFinite(floor)) facts.push(`monotone floor ${formatNumber(100 * floor)} %`);
  if (model !== materials[state.material]) facts.unshift(model.name);
  document.getElementById("facts").textContent = facts.join(" · ");
  const { file, description } = model.source ?? {};
  document.getElementById("source").textContent = description || (file ? `fitted to ${file}` : "");
  if (changed.has("material") || changed.has("channel")) showChannels(model);
}

function showChannels(model) {
  const choice = (value, label) => {
    const radio = html("input", { type: "radio", name: "channel", checked: state.channel === value });
    radio.addEventListener("change", () => setState({ channel: value }));
    return html("label", {}, radio, html("span", {}, label));
  };
  const focused = channels.contains(document.activeElement);
  const names = channelNames(model).map((name) => name[0].toUpperCase() + name.slice(1));
  channels.replaceChildren(
    channels.firstElementChild,
    choice(null, "All"),
    ...names.map((name, i) => choice(i, name)),
  );
  channels.hidden = model.nChannels === 1;
  if (focused) channels.querySelector(":checked").focus();
}

function switchTheme() {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const { dataset } = document.documentElement;
  dataset.theme = (dataset.theme ?? (dark ? "dark" : "light")) === "dark" ? "light" : "dark";
}

startHeader();
startLobes();
startCurves(() => materials[state.second]);
startImageSlice();
startParameters();
startAlbedo();
startSelection();
const shaders = JSON.parse(document.getElementById("shaders").textContent);
startDownloads((model) => bakedGlsl(model, shaders));
const sphere = startSphere(shaders);
startMap();
subscribe(() => performance.mark("drawn"));
readFragment();
addEventListener("hashchange", readFragment);

/** For the console, and for tests. */
window.dsbrdf = { meta, materials, state, setState, sphere, evaluate, albedo, currentModel };
