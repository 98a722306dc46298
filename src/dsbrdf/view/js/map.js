// The materials as small spheres, laid out by likeness; click opens one, shift-click a second to compare or blend with.

import { drawChip } from "./chips.js";
import { materials } from "./data.js";
import { meta } from "./meta.js";
import { formatNumber, html } from "./plot.js";
import { canBlend, chooseSecond, setState, state, subscribe } from "./state.js";

/** Pixels of a picture, drawn 1.5 times finer than it is shown. */
const CHIP = 44;
/** Milliseconds of drawing before the page may answer. */
const PATIENCE = 30;
/** Errors that are told of a material. */
const SHOWN_ERRORS = 3;
/** More materials than this are shown smaller. */
const MANY = 40;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const holder = document.getElementById("map");
const details = document.getElementById("map-details");
let chips = [];

export function startMap() {
  const section = document.getElementById("map-section");
  if (materials.length < 2) return void (section.hidden = true);
  holder.classList.toggle("row", !meta.space);
  holder.classList.toggle("many", materials.length > MANY);
  document.getElementById("map-note").textContent = meta.space?.description ?? "";
  chips = materials.map(makeChip);
  holder.replaceChildren(...chips);
  holder.addEventListener("keydown", moveFocus);
  document
    .getElementById("mix")
    .addEventListener("input", (event) => setState({ mix: event.target.valueAsNumber, compare: "none" }));
  document.getElementById("drop-second").addEventListener("click", () => chooseSecond(-1));
  subscribe(showMap);
  drawChips(0);
}

function makeChip(material, i) {
  const canvas = html("canvas", { "aria-hidden": "true" });
  const name = html("span", { className: "chip-name", "aria-hidden": "true" }, material.name);
  const button = html(
    "div",
    { className: "chip", role: "option", tabIndex: -1, "aria-label": material.name },
    canvas,
    name,
  );
  if (material.position) {
    button.style.left = `${100 * material.position[0]}%`;
    button.style.top = `${100 * (1 - material.position[1])}%`;
    // Names stay inside the page
    if (material.position[0] < 1 / 3) name.classList.add("from-left");
    if (material.position[0] > 2 / 3) name.classList.add("to-right");
  }
  button.addEventListener("click", (event) => choose(i, event.shiftKey));
  button.addEventListener("pointerenter", () => showDetails(material));
  button.addEventListener("focus", () => showDetails(material));
  button.addEventListener("pointerleave", () => showDetails(materials[state.material]));
  return button;
}

function choose(i, asSecond) {
  if (!asSecond) return setState({ material: i });
  chooseSecond(state.second === i ? -1 : i);
}

/** Pictures a few at a time, so that the page answers meanwhile. */
function drawChips(from) {
  const start = performance.now();
  let i = from;
  while (i < chips.length && performance.now() - start < PATIENCE) {
    drawChip(chips[i].firstChild, materials[i], CHIP);
    i++;
  }
  if (i < chips.length) setTimeout(() => drawChips(i), 0);
}

function moveFocus(event) {
  const i = chips.indexOf(document.activeElement);
  if (i < 0) return;
  if (event.key === "Enter" || event.key === " ") {
    event.preventDefault();
    return choose(i, event.shiftKey);
  }
  const direction = ARROWS[event.key];
  if (!direction) return;
  event.preventDefault();
  chips[neighbour(i, direction)]?.focus();
}

/** The chip nearest in a direction; sideways distance counts double. */
function neighbour(from, [dx, dy]) {
  const centre = (chip) => [chip.offsetLeft, chip.offsetTop];
  const [x, y] = centre(chips[from]);
  let best = { index: -1, cost: Infinity };
  chips.forEach((chip, index) => {
    const [u, v] = centre(chip);
    const along = (u - x) * dx + (v - y) * dy;
    const across = Math.abs((u - x) * dy) + Math.abs((v - y) * dx);
    const cost = along + 2 * across;
    if (along > 0 && cost < best.cost) best = { index, cost };
  });
  return best.index;
}

function showDetails(material) {
  const facts = [`${material.nLobes} ${material.nLobes === 1 ? "lobe" : "lobes"}`];
  for (const [key, value] of Object.entries(material.errors).slice(0, SHOWN_ERRORS)) {
    facts.push(`${key} ${formatNumber(value, 2)}`);
  }
  if (material.scores)
    facts.push(`scores ${material.scores.map((score) => formatNumber(score, 2)).join(", ")}`);
  details.replaceChildren(html("strong", {}, material.name), ` ${facts.join(", ")}`);
}

function showMap() {
  chips.forEach((chip, i) => {
    chip.classList.toggle("second", i === state.second);
    chip.setAttribute("aria-selected", i === state.material || i === state.second);
    chip.classList.toggle("first", i === state.material);
    chip.tabIndex = i === state.material ? 0 : -1;
  });
  const blend = document.getElementById("blend");
  blend.hidden = state.second === null;
  if (state.second !== null) {
    const [first, second] = [materials[state.material].name, materials[state.second].name];
    document.getElementById("mix").disabled = !canBlend();
    document.getElementById("mix").valueAsNumber = state.mix;
    document
      .getElementById("mix")
      .setAttribute("aria-valuetext", `${Math.round(100 * state.mix)} % ${second}`);
    document.getElementById("blend-first").textContent = first;
    document.getElementById("blend-second").textContent = second;
  }
  showDetails(materials[state.material]);
}
