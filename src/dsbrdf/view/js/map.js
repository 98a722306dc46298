// The materials on a map that zooms: points, of which those with room around them are seen as small spheres.
//
// A material has room for all zooms above one that depends on those before it in the list alone; so what is a sphere
// stays one while the map moves, and few are drawn however many there are.

import { chipImage, pointColour } from "./chips.js";
import { materials, places } from "./data.js";
import { meta } from "./meta.js";
import { formatNumber, html, onResize } from "./plot.js";
import { canBlend, chooseSecond, setState, state, subscribe } from "./state.js";

/** Pixels of a picture, its least and greatest size on the page; smaller where there are many materials. */
const CHIP = 54;
const [SMALL, LARGE, MANY, SHRINK] = [30, 44, 40, 0.73];
/** Pictures may come so near each other, in sizes of one. */
const OVERLAP = 0.8;
/** Milliseconds of drawing pictures in a frame, and how many are kept. */
const PATIENCE = 12;
const KEPT = 600;
/** Pixels around a material within which its name is shown, and names at once, at most. */
const NAME_ROOM = 76;
const MOST_NAMES = 24;
/** Errors that are told of a material. */
const SHOWN_ERRORS = 3;
const MARGIN = 26;
const [MAX_ZOOM, STEP] = [4000, 1.6];
/** Pixels a pointer may move in a click. */
const STILL = 4;
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

const holder = document.getElementById("map");
const canvas = document.getElementById("map-canvas");
const overlay = document.getElementById("map-overlay");
const details = document.getElementById("map-details");
const context = canvas.getContext("2d");
const pictures = new Map();
const colours = new Array(materials.length).fill(null);
const home = { zoom: 1, x: 0.5, y: 0.5 };
const view = { ...home };
let width = 0;
let height = 0;
/** Distance in pixels, at zoom 1, to the nearest material before it in the list. */
let room = null;
/** What was drawn last: places on the canvas, and who is a sphere. */
const drawn = { x: new Float32Array(materials.length), y: new Float32Array(materials.length), chips: [] };
let cursor = null;
/** Materials whose colours as points are known: so many of the first. */
let coloured = 0;
let scheduled = false;

export function startMap() {
  const section = document.getElementById("map-section");
  if (!places.length) return void (section.hidden = true);
  holder.classList.toggle("few", materials.length === 2);
  document.getElementById("map-note").textContent = meta.map.about;
  canvas.setAttribute("aria-label", `Map of ${materials.length} materials`);
  startPointer();
  canvas.addEventListener("keydown", pressKey);
  canvas.addEventListener("blur", () => moveCursor(null));
  const zooms = { "zoom-in": () => zoomBy(STEP), "zoom-out": () => zoomBy(1 / STEP), "zoom-fit": fit };
  for (const [id, action] of Object.entries(zooms)) document.getElementById(id).addEventListener("click", action);
  document
    .getElementById("mix")
    .addEventListener("input", (event) => setState({ mix: event.target.valueAsNumber, compare: "none" }));
  document.getElementById("drop-second").addEventListener("click", () => chooseSecond(-1));
  subscribe(showMap);
  onResize(holder, measure);
  measure();
}

/** For tests: where a material is on the page, and who is seen as a sphere. */
export const mapState = () => ({ ...view, chips: [...drawn.chips], x: [...drawn.x], y: [...drawn.y] });

function measure() {
  const ratio = Math.min(devicePixelRatio, 2);
  width = holder.clientWidth;
  height = holder.clientHeight;
  if (!width) return;
  Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
  room ??= roomOfAll();
  redraw();
}

const spanX = () => Math.max(width - 2 * MARGIN, 1);
const spanY = () => Math.max(height - 2 * MARGIN, 1);

function roomOfAll() {
  const n = places.length;
  const [xs, ys] = [0, 1].map((axis) => Float32Array.from(places, ({ at }) => at[axis] * [spanX(), spanY()][axis]));
  const squared = new Float32Array(n).fill(Infinity);
  for (let i = 1; i < n; i++) {
    const [x, y] = [xs[i], ys[i]];
    let least = Infinity;
    for (let j = 0; j < i; j++) {
      const distance = (xs[j] - x) * (xs[j] - x) + (ys[j] - y) * (ys[j] - y);
      if (distance < least) least = distance;
    }
    squared[i] = least;
  }
  return squared.map(Math.sqrt);
}

/** Pixels of a sphere: they grow a little with the zoom. */
function chipSize() {
  const size = SMALL * (materials.length > MANY ? SHRINK : 1) * view.zoom ** 0.2;
  return Math.min(size, LARGE);
}

function redraw() {
  if (scheduled) return;
  scheduled = true;
  requestAnimationFrame(draw);
}

function draw() {
  scheduled = false;
  if (!width) return;
  const size = chipSize();
  const ratio = canvas.width / width;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  const [factorX, factorY] = [spanX() * view.zoom, spanY() * view.zoom];
  const chips = [];
  for (let i = 0; i < places.length; i++) {
    const { at } = places[i];
    const x = width / 2 + (at[0] - view.x) * factorX;
    const y = height / 2 - (at[1] - view.y) * factorY;
    drawn.x[i] = x;
    drawn.y[i] = y;
    if (x < -size || y < -size || x > width + size || y > height + size) continue;
    if (isChosen(i) || hasRoom(i, size)) {
      chips.push(i);
      continue;
    }
    context.fillStyle = colours[i] ?? "#888";
    context.fillRect(x - 1.5, y - 1.5, 3, 3);
  }
  drawn.chips = chips;
  const until = performance.now() + PATIENCE;
  let isDone = true;
  // Those chosen lie on top
  for (const i of [...chips].sort((a, b) => isChosen(a) - isChosen(b))) {
    const picture = pictureOf(i, until);
    if (picture) context.drawImage(picture, drawn.x[i] - size / 2, drawn.y[i] - size / 2, size, size);
    else {
      isDone &&= pictures.has(i);
      context.fillStyle = colours[i] ??= pointColour(materials[i]);
      context.beginPath();
      context.arc(drawn.x[i], drawn.y[i], size / 2, 0, 2 * Math.PI);
      context.fill();
    }
  }
  overlay.replaceChildren(...rings(size), ...names(size));
  if (colour(until) || !isDone) redraw();
}

/** Find the colours of more materials; returns whether there were any to be found. */
function colour(until) {
  if (coloured === materials.length) return false;
  while (coloured < materials.length && performance.now() < until) {
    colours[coloured] ??= pointColour(materials[coloured]);
    coloured++;
  }
  return true;
}

const hasRoom = (i, size) => room[i] * view.zoom >= OVERLAP * size;
const isChosen = (i) => i === state.material || i === state.second || i === cursor;

/** The picture of a material; begun if there is time for it. */
function pictureOf(i, until) {
  if (!pictures.has(i) && performance.now() < until) {
    pictures.set(i, null);
    createImageBitmap(chipImage(materials[i], CHIP)).then((picture) => {
      pictures.set(i, picture);
      redraw();
    });
    if (pictures.size > KEPT) pictures.delete(pictures.keys().next().value);
  }
  return pictures.get(i) ?? null;
}

function rings(size) {
  const ring = (i, kind) => {
    const node = html("span", { className: `ring ${kind}` });
    Object.assign(node.style, { left: `${drawn.x[i]}px`, top: `${drawn.y[i]}px`, width: `${size}px` });
    return node;
  };
  const chosen = [
    [state.material, "first"],
    [state.second, "second"],
    [cursor, "cursor"],
  ];
  return chosen.flatMap(([i, kind]) => (i === null ? [] : [ring(i, kind)]));
}

/** Names of what has room, and of what is chosen, none over another. */
function names(size) {
  context.font = "12px system-ui, sans-serif";
  const near = drawn.chips.filter((i) => isChosen(i) || room[i] * view.zoom >= NAME_ROOM);
  near.sort((a, b) => (b === cursor) - (a === cursor) || isChosen(b) - isChosen(a));
  const boxes = [];
  const shown = [];
  for (const i of near) {
    if (shown.length >= MOST_NAMES) break;
    const half = Math.min(context.measureText(materials[i].name).width, 200) / 2 + 6;
    const middle = Math.min(Math.max(drawn.x[i], half), width - half);
    const top = drawn.y[i] + size / 2 + 3;
    const isIn = (x, y, w, h) => Math.abs(x - middle) < w + half && Math.abs(y - top - 8) < h + 8;
    const isFree =
      boxes.every(([x, y, w]) => !isIn(x, y + 8, w, 10)) &&
      (isChosen(i) || drawn.chips.every((j) => j === i || !isIn(drawn.x[j], drawn.y[j], size / 2, size / 2)));
    if (!isFree || drawn.y[i] < 0 || top > height) continue;
    boxes.push([middle, top, half]);
    const node = html("span", { className: "map-name" }, materials[i].name);
    Object.assign(node.style, { left: `${middle}px`, top: `${top}px` });
    shown.push(node);
  }
  return shown;
}

/** The material at a place on the canvas; null where there is none. */
function materialAt(x, y) {
  const reach = chipSize() / 2;
  const nearest = (candidates, most) => {
    let best = null;
    let least = most * most;
    for (const i of candidates) {
      const distance = (drawn.x[i] - x) ** 2 + (drawn.y[i] - y) ** 2;
      if (distance <= least) [best, least] = [i, distance];
    }
    return best;
  };
  return nearest(drawn.chips, reach) ?? nearest(materials.keys(), 8);
}

function startPointer() {
  const pointers = new Map();
  let moved = 0;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    if (pointers.size === 1) moved = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const at = place(event);
    const before = pointers.get(event.pointerId);
    if (!before) return showDetails(materialAt(...at) ?? state.material);
    pointers.set(event.pointerId, at);
    moved += Math.hypot(at[0] - before[0], at[1] - before[1]);
    if (moved < STILL) return;
    if (pointers.size === 1) return panBy(at[0] - before[0], at[1] - before[1]);
    const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
    const gap = ([x, y]) => Math.max(Math.hypot(x - other[0], y - other[1]), 1);
    zoomBy(gap(at) / gap(before), other);
  });
  canvas.addEventListener("pointerup", (event) => {
    const at = place(event);
    const wasAlone = pointers.size === 1;
    pointers.delete(event.pointerId);
    const found = wasAlone && moved < STILL ? materialAt(...at) : null;
    if (found !== null) choose(found, event.shiftKey);
  });
  canvas.addEventListener("pointercancel", (event) => pointers.delete(event.pointerId));
  canvas.addEventListener("pointerleave", () => showDetails(state.material));
  // The page scrolls until the map is what one works with
  canvas.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && document.activeElement !== canvas) return;
      event.preventDefault();
      zoomBy(Math.exp(-0.002 * event.deltaY), place(event));
    },
    { passive: false },
  );
}

function panBy(right, down) {
  view.x = clamp(view.x - right / (spanX() * view.zoom));
  view.y = clamp(view.y + down / (spanY() * view.zoom));
  redraw();
}

const clamp = (share) => Math.min(Math.max(share, 0), 1);

/** What is at `point` stays there; by default the middle. */
function zoomBy(factor, [x, y] = [width / 2, height / 2]) {
  const zoom = Math.min(Math.max(view.zoom * factor, 1), MAX_ZOOM);
  const shift = 1 / view.zoom - 1 / zoom;
  view.x = clamp(view.x + ((x - width / 2) / spanX()) * shift);
  view.y = clamp(view.y - ((y - height / 2) / spanY()) * shift);
  view.zoom = zoom;
  if (zoom === 1) Object.assign(view, home);
  redraw();
}

function fit() {
  Object.assign(view, home);
  redraw();
}

/** Bring a material into the middle, where it is not seen. */
function reveal(i) {
  const x = width / 2 + (places[i].at[0] - view.x) * spanX() * view.zoom;
  const y = height / 2 - (places[i].at[1] - view.y) * spanY() * view.zoom;
  if (x < 0 || y < 0 || x > width || y > height) [view.x, view.y] = places[i].at;
  redraw();
}

function choose(i, asSecond) {
  if (!asSecond) return setState({ material: i });
  chooseSecond(state.second === i ? -1 : i);
}

function moveCursor(i) {
  cursor = i;
  if (i === null) return redraw();
  showDetails(i);
  reveal(i);
}

function pressKey(event) {
  const { key } = event;
  const at = cursor ?? state.material;
  if (ARROWS[key]) moveCursor(neighbour(at, ARROWS[key]) ?? at);
  else if (key === "Enter" || key === " ") choose(at, event.shiftKey);
  else if (key === "+" || key === "=") zoomBy(STEP, [drawn.x[at], drawn.y[at]]);
  else if (key === "-") zoomBy(1 / STEP, [drawn.x[at], drawn.y[at]]);
  else if (key === "0") fit();
  else return;
  event.preventDefault();
}

/** The nearest sphere in a direction; sideways distance counts double. */
function neighbour(from, [dx, dy]) {
  const size = chipSize();
  let best = { index: null, cost: Infinity };
  for (let i = 0; i < materials.length; i++) {
    if (i === from || (!isChosen(i) && !hasRoom(i, size))) continue;
    const [x, y] = [drawn.x[i] - drawn.x[from], drawn.y[i] - drawn.y[from]];
    const along = x * dx + y * dy;
    const cost = along + 2 * (Math.abs(x * dy) + Math.abs(y * dx));
    if (along > 0 && cost < best.cost) best = { index: i, cost };
  }
  return best.index;
}

function showDetails(i) {
  const material = materials[i];
  const facts = [`${material.nLobes} ${material.nLobes === 1 ? "lobe" : "lobes"}`];
  for (const [key, value] of Object.entries(material.errors).slice(0, SHOWN_ERRORS)) {
    facts.push(`${key} ${formatNumber(value, 2)}`);
  }
  if (meta.map.scores) {
    const scores = Array.from(places[i].coordinates.subarray(0, 2), (score) => formatNumber(score, 2));
    facts.push(`scores ${scores.join(", ")}`);
  }
  details.replaceChildren(html("strong", {}, material.name), ` ${facts.join(", ")}`);
}

function showMap(changed) {
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
  if (!changed.has("material") && !changed.has("second")) return;
  showDetails(state.material);
  reveal(changed.has("material") ? state.material : (state.second ?? state.material));
}
