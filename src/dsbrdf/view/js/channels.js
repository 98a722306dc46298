// Names and colours of channels, colours and dashes of lobes; the same in every plot.

import { drawn, squarePath } from "./plot.js";

const DASHES = ["7 4", "9 3 2 3", "2 3", "10 3 2 3 2 3", "4 4", "1 4"];
const LOBE_COUNT = 6;

const WORDS = { r: "red", g: "green", b: "blue" };
/** More channels than this are shown by a few of them. */
const MOST_SHOWN = 7;

export function channelNames({ channels }) {
  return channels.map((name) => (channels.length === 3 ? (WORDS[name] ?? name) : name));
}

export function channelColour(model, channel) {
  const name = channelNames(model)[channel];
  if (model.nChannels === 3 && Object.values(WORDS).includes(name)) return `var(--${name})`;
  if (model.nChannels === 1) return "var(--ink)";
  const hue = 260 - (220 * rankOf(model, channel)) / (model.nChannels - 1);
  return `light-dark(hsl(${hue} 55% 42%), hsl(${hue} 55% 68%))`;
}

/** Channels named after wavelengths in their order, others as they come. */
function rankOf({ channels }, channel) {
  const numbers = channels.map(Number.parseFloat);
  if (numbers.some(Number.isNaN)) return channel;
  return numbers.filter((number) => number < numbers[channel]).length;
}

export const lobeColour = (lobe) => `var(--lobe-${lobe % LOBE_COUNT})`;
export const lobeDash = (lobe) => DASHES[lobe % LOBE_COUNT];

/** The channels that are shown: the chosen one, or all, or a few of many. */
export function shownChannels({ nChannels }, channel) {
  if (channel !== null) return [channel];
  const n = Math.min(nChannels, MOST_SHOWN);
  return Array.from({ length: n }, (_, i) => Math.round((i * (nChannels - 1)) / Math.max(n - 1, 1)));
}

/** A short piece of a line, for legends. */
export function lineSample(stroke, { dash = "none", width = 2 } = {}) {
  const line = drawn("line", {
    x2: 26,
    y1: 5,
    y2: 5,
    stroke,
    "stroke-dasharray": dash,
    "stroke-width": width,
  });
  return drawn("svg", { class: "sample", "aria-hidden": "true" }, line);
}

/** A measured point, for legends. */
export function pointSample(stroke) {
  const point = drawn("path", { d: squarePath(13, 5, 3), class: "measured", stroke });
  return drawn("svg", { class: "sample", "aria-hidden": "true" }, point);
}
