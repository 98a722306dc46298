// Names and colours of channels, colours and dashes of lobes; the same in every plot.

import { drawn, markerPath, MARKERS } from "./plot.js";

const DASHES = ["7 4", "9 3 2 3", "2 3", "10 3 2 3 2 3", "4 4", "1 4"];
const LOBE_COUNT = 6;

export function channelNames(model) {
  return model.nChannels === 3
    ? ["red", "green", "blue"]
    : Array.from({ length: model.nChannels }, (_, i) => `channel ${i}`);
}

export function channelColour(model, channel) {
  if (model.nChannels === 3) return `var(--${channelNames(model)[channel]})`;
  if (model.nChannels === 1) return "var(--ink)";
  const hue = 260 - (220 * channel) / (model.nChannels - 1);
  return `light-dark(hsl(${hue} 55% 42%), hsl(${hue} 55% 68%))`;
}

export const lobeColour = (lobe) => `var(--lobe-${lobe % LOBE_COUNT})`;
export const lobeDash = (lobe) => DASHES[lobe % LOBE_COUNT];
export const lobeMarker = (lobe) => MARKERS[lobe % LOBE_COUNT];

/** The channels that are shown: the chosen one, or all. */
export function shownChannels(model, channel) {
  return channel === null ? [...Array(model.nChannels).keys()] : [channel];
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
  const point = drawn("path", { d: markerPath("square", 13, 5, 3), class: "measured", stroke });
  return drawn("svg", { class: "sample", "aria-hidden": "true" }, point);
}
