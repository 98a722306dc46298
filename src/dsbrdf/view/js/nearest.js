// The materials nearest to the one on show, as a list.

import { drawChip } from "./chips.js";
import { materials, places } from "./data.js";
import { meta } from "./meta.js";
import { formatNumber, html } from "./plot.js";
import { chooseSecond, setState, state, subscribe } from "./state.js";

const COUNT = 8;
const CHIP = 42;
const list = document.getElementById("nearest");

/** The `n` materials nearest to one in the map's coordinates, and their distances. */
export function nearest(index, n = COUNT) {
  const from = places[index].coordinates;
  const distances = Float32Array.from(places, ({ coordinates }) => {
    let sum = 0;
    for (let i = 0; i < from.length; i++) sum += (coordinates[i] - from[i]) ** 2;
    return Math.sqrt(sum);
  });
  const order = [...materials.keys()].filter((i) => i !== index);
  order.sort((a, b) => distances[a] - distances[b]);
  return order.slice(0, n).map((i) => ({ index: i, name: materials[i].name, distance: distances[i] }));
}

export function startNearest() {
  const section = document.getElementById("nearest-section");
  if (places.length < 3) return void (section.hidden = true);
  document.getElementById("nearest-note").textContent = meta.map.distance;
  subscribe((changed) => {
    if (changed.has("material")) list.replaceChildren(...nearest(state.material).map(entry));
  });
}

function entry({ index, name, distance }) {
  const picture = html("canvas", { "aria-hidden": "true" });
  drawChip(picture, materials[index], CHIP);
  const button = html("button", { type: "button" }, picture, html("span", {}, name), formatNumber(distance, 2));
  button.addEventListener("click", (event) =>
    event.shiftKey ? chooseSecond(index) : setState({ material: index }),
  );
  return html("li", {}, button);
}
