// Put the page together.

import { albedo, startAlbedo } from "./albedo.js";
import { bakedGlsl } from "./baked_glsl.js";
import { channelNames, shownChannels } from "./channels.js";
import { components } from "./components.js";
import { startCurves } from "./curves.js";
import { materials } from "./data.js";
import { startDownloads } from "./download.js";
import { startImageSlice } from "./image_slice.js";
import { startLobes } from "./lobes.js";
import { mapState, startMap } from "./map.js";
import { nearest, startNearest } from "./nearest.js";
import { startParameters } from "./parameters.js";
import { evaluate, meanOverPhi, SHARED } from "./material.js";
import { meta } from "./meta.js";
import { formatNumber, html } from "./plot.js";
import { search, searchField } from "./search.js";
import { startSphere } from "./sphere_panel.js";
import { baseModel, currentModel, readFragment, setState, state, subscribe } from "./state.js";

/** More channels than this are in a list. */
const MOST_BUTTONS = 4;
const materialField = document.getElementById("material");
const channels = document.getElementById("channels");

function startHeader() {
  const show = searchField(materialField, {
    current: () => state.material,
    pick: (material) => setState({ material }),
  });
  subscribe(showHeader);
  subscribe((changed) => changed.has("material") && show());
  document.getElementById("theme").addEventListener("click", switchTheme);
}

function showHeader(changed) {
  const model = baseModel();
  document.title = `${model.name} · dsbrdf`;
  const count = (number, word) => `${number} ${word}${number === 1 ? "" : "s"}`;
  const facts = [
    count(model.nLobes, "lobe"),
    count(numbersOf(model), "number"),
    count(model.nChannels, "channel"),
  ];
  for (const [key, value] of Object.entries(model.errors ?? {})) {
    facts.push(`${key.replaceAll("_", " ")} ${formatNumber(value, 2)}`);
  }
  if (model !== materials[state.material]) facts.unshift(model.name);
  if (model.falseColours) facts.push(`false colours: ${shownAsRgb(model).join(", ")} as red, green, blue`);
  document.getElementById("facts").textContent = facts.join(" · ");
  const { file, description } = model.source ?? {};
  document.getElementById("source").textContent = description || (file ? `fitted to ${file}` : "");
  if (changed.has("material") || changed.has("channel")) showChannels(model);
}

/** Names of the channels that stand for red, green and blue. */
const shownAsRgb = ({ rgb, channels: names }) => rgb.map((weights) => names[weights.indexOf(1)]);

/** How many numbers describe the reflectance; what all channels share of a colour is part of the scale. */
function numbersOf({ nLobes, nChannels, sizes }) {
  const shared = SHARED.reduce((sum, key) => sum + sizes[key], 0);
  return nLobes * (shared + (nChannels - 1) * sizes.colour);
}

function showChannels(model) {
  if (model.nChannels > MOST_BUTTONS) return showChannelList(model);
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

/** A list, where buttons would be too many. */
function showChannelList(model) {
  const all = shownChannels(model, null).length < model.nChannels ? "Several" : "All";
  const names = [all, ...channelNames(model)];
  const options = names.map((name, i) => html("option", { value: i - 1 }, name));
  const select = html("select", { className: "small", "aria-label": "Channel" }, ...options);
  select.value = state.channel ?? -1;
  select.addEventListener("change", () =>
    setState({ channel: Number(select.value) < 0 ? null : Number(select.value) }),
  );
  const focused = channels.contains(document.activeElement);
  channels.replaceChildren(channels.firstElementChild, select);
  channels.hidden = false;
  if (focused) select.focus();
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
const shaders = JSON.parse(document.getElementById("shaders").textContent);
startDownloads((model) => bakedGlsl(model, shaders));
const sphere = startSphere(shaders);
startMap();
startNearest();
subscribe(() => performance.mark("drawn"));
readFragment();
addEventListener("hashchange", readFragment);

/** For the console, and for tests. */
window.dsbrdf = {
  meta,
  materials,
  state,
  setState,
  sphere,
  evaluate,
  meanOverPhi,
  albedo,
  components,
  currentModel,
  mapState,
  nearest,
  search,
};
