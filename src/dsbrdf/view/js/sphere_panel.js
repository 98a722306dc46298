// The sphere and its controls: environment, lighting, exposure, dragging, comparison.

import { drawChip } from "./chips.js";
import { materials } from "./data.js";
import { readEnvironment } from "./environment.js";
import { orbit } from "./orbit.js";
import { formatNumber, html, onResize } from "./plot.js";
import { searchField } from "./search.js";
import { ENVIRONMENTS, LIGHTINGS, Sphere } from "./sphere.js";
import {
  altersModel,
  baseModel,
  chooseSecond,
  COMPARISONS,
  currentModel,
  setState,
  state,
  subscribe,
} from "./state.js";

const OWN_IMAGE = "own image";
const canvas = document.getElementById("sphere");
/** Shown where there is no WebGL2; a canvas has one kind of context for life. */
const canvas2d = document.getElementById("sphere-2d");
const panel = document.getElementById("sphere-panel");
const message = document.getElementById("sphere-message");
const environmentSelect = document.getElementById("environment");
const exposureSlider = document.getElementById("exposure");

let sphere = null;
let showSecond = () => {};
/** Until the first samples are there, the simpler sphere is seen. */
let isWaiting = true;

export function startSphere(shaders) {
  fillChoices();
  sphere = new Sphere(canvas, shaders, { onError: showWithoutWebGL, onProgress: showProgress });
  orbit(canvas, sphere, { mode: () => document.querySelector("input[name=drag]:checked").value });
  document.getElementById("reset-view").addEventListener("click", () => sphere.resetRotation());
  exposureSlider.addEventListener("input", () => setState({ exposure: exposureSlider.valueAsNumber }));
  environmentSelect.addEventListener("change", () => setState({ environment: environmentSelect.value }));
  document.getElementById("own-image").addEventListener("change", (event) => useImage(event.target.files[0]));
  startDrop();
  for (const type of ["pointermove", "wheel", "keydown"]) {
    const giveWay = ({ target }) => target !== canvas && sphere.giveWay();
    document.addEventListener(type, giveWay, { capture: true, passive: true });
  }
  canvas2d.hidden = false;
  subscribe(updateSphere);
  onResize(canvas, () => sphere.resize());
  sphere.resize();
  sphere.start();
  return sphere;
}

function fillChoices() {
  environmentSelect.append(...ENVIRONMENTS.map(({ name, label }) => html("option", { value: name }, label)));
  const lighting = document.getElementById("lighting");
  lighting.append(...LIGHTINGS.map(({ name, label }) => html("option", { value: name }, label)));
  lighting.addEventListener("change", () => setState({ lighting: lighting.value }));
  const second = document.getElementById("second");
  showSecond = searchField(second, { current: () => state.second, pick: chooseSecond, none: "none" });
  second.closest(".field").hidden = materials.length < 2;
  const compare = document.getElementById("compare");
  for (const [value, label] of Object.entries(COMPARISONS)) {
    const radio = html("input", {
      type: "radio",
      name: "compare",
      value,
      onchange: () => setState({ compare: value }),
    });
    compare.append(html("label", {}, radio, html("span", {}, label)));
  }
}

/** What to draw on the two halves; the right one is null for a whole sphere. */
function halves() {
  const model = currentModel();
  if (state.compare === "second" && state.second !== null) return [model, materials[state.second]];
  if (state.compare === "measured" && baseModel().profile) return [{ ...baseModel(), measured: true }, model];
  return [model, null];
}

function updateSphere(changed) {
  const [left, right] = halves();
  if (altersModel(changed)) sphere.setMaterials(left, right);
  if (changed.has("environment")) useEnvironment();
  if (changed.has("lighting")) sphere.setLighting(state.lighting);
  if (changed.has("exposure")) sphere.setExposure(state.exposure);
  showSphereControls(right);
  if (isWaiting || panel.classList.contains("without-webgl")) drawChip(canvas2d, currentModel(), 256);
}

function useEnvironment() {
  environmentSelect.value = state.environment;
  if (state.environment !== OWN_IMAGE) sphere.setEnvironment(state.environment);
}

function showSphereControls(right) {
  exposureSlider.valueAsNumber = state.exposure;
  const sign = state.exposure > 0 ? "+" : "";
  document.getElementById("exposure-value").textContent = `${sign}${formatNumber(state.exposure)} EV`;
  document.getElementById("lighting").value = state.lighting;
  showSecond();
  for (const radio of document.querySelectorAll("input[name=compare]")) {
    radio.checked = radio.value === state.compare;
    radio.disabled =
      (radio.value === "second" && state.second === null) ||
      (radio.value === "measured" && !baseModel().profile);
  }
  const names = state.compare === "measured" ? ["measured", "fitted"] : [baseModel().name, right?.name];
  document
    .getElementById("half-names")
    .replaceChildren(...(right ? names.map((name) => html("span", {}, name)) : []));
  const what = right ? `${names.join(" and ")} side by side on one sphere` : `A sphere of ${names[0]}`;
  canvas.setAttribute("aria-label", `${what}. Drag or use the arrow keys to turn.`);
}

function showProgress({ nSamples, maxSamples }) {
  if (isWaiting && nSamples > 0) {
    isWaiting = false;
    canvas2d.hidden = true;
  }
  document.getElementById("progress").textContent = `${nSamples} of ${maxSamples} samples`;
}

function showWithoutWebGL(text) {
  message.textContent = `${text} In its place is a simpler one, under two distant lights.`;
  message.hidden = false;
  panel.classList.add("without-webgl");
  canvas.hidden = true;
  canvas2d.hidden = false;
  drawChip(canvas2d, currentModel(), 256);
  for (const control of panel.querySelectorAll(".needs-webgl")) control.hidden = true;
}

async function useImage(file) {
  if (!file) return;
  message.hidden = true;
  try {
    sphere.setEnvironmentImage(await readEnvironment(file));
    const option =
      [...environmentSelect.options].find(({ value }) => value === OWN_IMAGE) ??
      html("option", { value: OWN_IMAGE });
    option.textContent = file.name;
    environmentSelect.append(option);
    environmentSelect.value = OWN_IMAGE;
    setState({ environment: OWN_IMAGE, lighting: "environment" });
  } catch (error) {
    message.textContent = error.message;
    message.hidden = false;
  }
}

function startDrop() {
  const mark = (over) => panel.classList.toggle("drop", over);
  panel.addEventListener("dragover", (event) => {
    event.preventDefault();
    mark(true);
  });
  panel.addEventListener("dragleave", () => mark(false));
  panel.addEventListener("drop", (event) => {
    event.preventDefault();
    mark(false);
    useImage(event.dataTransfer.files[0]);
  });
}
