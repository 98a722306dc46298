// What the page shows: one store, whose part that a link can carry stands in the fragment of the address.

import { indexOfMaterial, materials } from "./data.js";
import { betweenModels, editedModel, noEdit } from "./material.js";
import { ENVIRONMENTS, LIGHTINGS } from "./sphere.js";

const SHORT = new Intl.NumberFormat("en", { maximumSignificantDigits: 4, useGrouping: false });

export const COMPARISONS = { none: "Off", measured: "Measured", second: "Second" };

const defaults = () => ({
  material: 0,
  second: null,
  mix: 0,
  compare: "none",
  thetaD: 40,
  log: true,
  channel: null,
  edits: [],
  environment: ENVIRONMENTS[0].name,
  lighting: "environment",
  exposure: 0,
});

export const state = defaults();
const listeners = [];
let scheduled = null;

/** Call `listener(changed)` with the set of changed keys, once a frame at most, and once at the start. */
export function subscribe(listener) {
  listeners.push(listener);
}

export function setState(changes) {
  const changed = Object.keys(changes).filter((key) => changes[key] !== state[key]);
  if (!changed.length) return;
  Object.assign(state, changes);
  if (changed.some((key) => ["material", "second", "mix"].includes(key))) mendState(changed);
  schedule(changed);
}

function schedule(keys) {
  if (!scheduled) {
    scheduled = new Set();
    requestAnimationFrame(announce);
  }
  keys.forEach((key) => scheduled.add(key));
}

/** Bring what depends on the materials in line with them. */
function mendState(changed) {
  if (state.second === state.material || state.second === null) {
    Object.assign(state, {
      second: null,
      mix: 0,
      compare: state.compare === "second" ? "none" : state.compare,
    });
    changed.push("second", "mix", "compare");
  }
  const model = baseModel();
  if (changed.includes("material") || model.nLobes !== state.edits.length) {
    state.edits = Array.from({ length: model.nLobes }, noEdit);
    changed.push("edits");
  }
  if (state.compare === "measured" && !model.profile) {
    state.compare = "none";
    changed.push("compare");
  }
  if (state.channel !== null && state.channel >= model.nChannels) state.channel = null;
}

function announce() {
  const changed = scheduled;
  scheduled = null;
  writeFragment();
  listeners.forEach((listener) => listener(changed));
}

let between = { key: "", model: null };

/** The model on show before its lobes are edited: a material, or one between two. */
export function baseModel() {
  const first = materials[state.material];
  if (!canBlend() || state.mix === 0 || state.compare === "second") return first;
  const key = [state.material, state.second, state.mix].join();
  if (between.key !== key) between = { key, model: betweenModels(first, materials[state.second], state.mix) };
  return between.model;
}

/** Whether there is a second material, with the same channels. */
export function canBlend() {
  return state.second !== null && materials[state.second].nChannels === materials[state.material].nChannels;
}

export function currentModel() {
  return editedModel(baseModel(), state.edits);
}

/** Change the edit of one lobe. */
export function editLobe(lobe, change) {
  setState({ edits: state.edits.map((edit, k) => (k === lobe ? { ...edit, ...change } : edit)) });
}

/** Take a second material, to compare or blend with; none for -1. */
export function chooseSecond(index) {
  if (index < 0 || index === state.material) return setState({ second: null });
  setState({ second: index, compare: state.compare === "none" && !state.mix ? "second" : state.compare });
}

/** Whether one of the changed keys alters the model on show. */
export function altersModel(changed) {
  return ["material", "second", "mix", "compare", "edits"].some((key) => changed.has(key));
}

const linkName = (key) => (key === "thetaD" ? "theta_d" : key);

function writeFragment() {
  const initial = defaults();
  const entries = [["material", materials[state.material].name]];
  if (state.second !== null) entries.push(["second", materials[state.second].name]);
  for (const key of ["thetaD", "mix", "exposure", "channel", "compare", "environment", "lighting"]) {
    const value = state[key];
    if (value !== initial[key])
      entries.push([linkName(key), typeof value === "number" ? SHORT.format(value) : value]);
  }
  if (!state.log) entries.push(["scale", "linear"]);
  const { edits } = state;
  if (edits.some(({ on }) => !on)) entries.push(["lobes", edits.map(({ on }) => Number(on)).join("")]);
  for (const key of ["kappa", "gamma"]) {
    if (edits.some((edit) => edit[key] !== 1))
      entries.push([key, edits.map((edit) => SHORT.format(edit[key])).join()]);
  }
  // A page inside another has no address of its own
  try {
    history.replaceState(null, "", `#${new URLSearchParams(entries)}`);
  } catch {
    return;
  }
}

/** Take over what a link carries; what is not understood is left as it is. */
export function readFragment() {
  const link = new URLSearchParams(location.hash.slice(1));
  const next = defaults();
  next.material = Math.max(0, indexOfMaterial(link.get("material")));
  const second = indexOfMaterial(link.get("second"));
  if (second >= 0) next.second = second;
  readNumbers(link, next);
  if (Object.hasOwn(COMPARISONS, link.get("compare"))) next.compare = link.get("compare");
  if (LIGHTINGS.some(({ name }) => name === link.get("lighting"))) next.lighting = link.get("lighting");
  if (ENVIRONMENTS.some(({ name }) => name === link.get("environment")))
    next.environment = link.get("environment");
  next.log = link.get("scale") !== "linear";
  Object.assign(state, next);
  mendState(["material"]);
  readEdits(link);
  schedule(Object.keys(state));
}

function readNumbers(link, next) {
  const limits = {
    mix: [0, 1],
    thetaD: [0, 90],
    exposure: [-6, 6],
    channel: [0, materials[next.material].nChannels - 1],
  };
  for (const [key, [low, high]] of Object.entries(limits)) {
    const value = Number.parseFloat(link.get(linkName(key)));
    if (value >= low && value <= high) next[key] = value;
  }
}

function readEdits(link) {
  const on = link.get("lobes") ?? "";
  const factors = { kappa: link.get("kappa")?.split(","), gamma: link.get("gamma")?.split(",") };
  state.edits = state.edits.map((edit, k) => {
    const read = { ...edit, on: on[k] !== "0" };
    for (const key of ["kappa", "gamma"]) {
      const value = Number.parseFloat(factors[key]?.[k]);
      if (value >= 0.01 && value <= 100) read[key] = value;
    }
    return read;
  });
}
