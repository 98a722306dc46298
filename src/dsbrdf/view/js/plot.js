// Plots as SVG: scales, axes, lines and points. Colours and fonts are those of the style sheet.

const SVG = "http://www.w3.org/2000/svg";
const MARGIN = { left: 52, right: 14, top: 26, bottom: 40 };
let clipCount = 0;

/** An SVG element with attributes and children. */
export function drawn(tag, attributes = {}, ...children) {
  const node = document.createElementNS(SVG, tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}

/** An HTML element with properties and children. */
export function html(tag, properties = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key.includes("-") || key === "role" || key === "for") node.setAttribute(key, value);
    else node[key] = value;
  }
  node.append(...children);
  return node;
}

/** Text in which `_x` sets x as a subscript, as nodes of HTML. */
export function withSubscripts(text) {
  return text.split(/(_\w)/).map((part) => (part.startsWith("_") ? html("sub", {}, part.slice(1)) : part));
}

export function formatNumber(value, digits = 3) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e5)) {
    const [mantissa, exponent] = value.toExponential(digits - 2).split("e");
    return `${mantissa}·10${superscript(Number(exponent))}`;
  }
  return String(Number(value.toPrecision(digits)));
}

function superscript(exponent) {
  return String(exponent).replace(/[-\d]/g, (character) => "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"["-0123456789".indexOf(character)]);
}

export function linearScale(low, high, ticks = niceTicks(low, high), label = (tick) => formatNumber(tick)) {
  return { to: (value) => (value - low) / (high - low), from: (at) => low + at * (high - low), ticks, label };
}

/** Signed square root: narrow peaks in the middle get room. */
export function rootScale(low, high, ticks, label = (tick) => `${Math.abs(tick)}`) {
  const root = (value) => Math.sign(value) * Math.sqrt(Math.abs(value));
  const [bottom, top] = [root(low), root(high)];
  const from = (at) => ((at1) => Math.sign(at1) * at1 ** 2)(bottom + at * (top - bottom));
  return { to: (value) => (root(value) - bottom) / (top - bottom), from, ticks, label };
}

export function logScale(low, high) {
  const [bottom, top] = [Math.log10(low), Math.log10(high)];
  const at = (value) => (Math.log10(value) - bottom) / (top - bottom);
  // Lines may leave the frame, but not by infinity
  const to = (value) => (value > 0 ? Math.max(at(value), -2) : Number.isNaN(value) ? NaN : -2);
  return {
    to,
    from: (share) => 10 ** (bottom + share * (top - bottom)),
    ticks: decadeTicks(bottom, top),
    label: formatTick,
  };
}

const formatTick = (tick) => {
  const exponent = Math.log10(tick);
  const whole = Math.abs(exponent - Math.round(exponent)) < 1e-9;
  return whole && Math.abs(exponent) > 2 ? `10${superscript(Math.round(exponent))}` : formatNumber(tick, 2);
};

function decadeTicks(bottom, top) {
  const decades = top - bottom;
  const step = Math.max(1, Math.ceil(decades / 7));
  const factors = decades < 1 ? [1, 2, 5] : decades < 2.5 ? [1, 3] : [1];
  const ticks = [];
  for (let i = Math.floor(bottom); i <= top; i++) {
    if (i % step) continue;
    for (const factor of factors) {
      const at = i + Math.log10(factor);
      if (at >= bottom - 1e-9 && at <= top + 1e-9) ticks.push(factor * 10 ** i);
    }
  }
  return ticks;
}

export function niceTicks(low, high, count = 5) {
  const rough = (high - low) / count;
  const unit = 10 ** Math.floor(Math.log10(rough));
  const step = unit * [1, 2, 5, 10].find((factor) => factor * unit >= rough);
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) ticks.push(i * step);
  return ticks;
}

/** Bounds of a logarithmic axis that holds positive values, some decades below the largest at most. */
export function logBounds(values, decades = 5) {
  let [low, high] = [Infinity, 0];
  for (const value of values) {
    if (value > 0) [low, high] = [Math.min(low, value), Math.max(high, value)];
  }
  if (!high) return [0.1, 1];
  return [Math.max(0.6 * low, high * 10 ** -decades), 1.8 * high];
}

/**
 * An empty plot in `holder`, which is a div of some size; scales map to pixels through `x` and `y`.
 * `label` tells what is shown to who cannot see it.
 */
export class Plot {
  constructor(holder, { x, y, xTitle, yTitle, label, margin = {} }) {
    const width = Math.max(holder.clientWidth, 120);
    const height = Math.max(holder.clientHeight, 120);
    const { left, right, top, bottom } = { ...MARGIN, ...margin };
    this.box = { left, top, width: width - left - right, height: height - top - bottom };
    this.scales = { x, y };
    this.svg = drawn("svg", {
      viewBox: `0 0 ${width} ${height}`,
      width,
      height,
      role: "img",
      "aria-label": label,
    });
    const clip = `clip-${clipCount++}`;
    const { box } = this;
    const area = { x: box.left, y: box.top, width: box.width, height: box.height };
    this.svg.append(drawn("clipPath", { id: clip }, drawn("rect", area)));
    this.grid = drawn("g", { class: "grid" });
    this.marks = drawn("g", { "clip-path": `url(#${clip})` });
    this.svg.append(this.grid, this.marks);
    this.#axes(xTitle, yTitle);
    holder.replaceChildren(this.svg);
  }

  x(value) {
    return this.box.left + this.box.width * this.scales.x.to(value);
  }

  y(value) {
    return this.box.top + this.box.height * (1 - this.scales.y.to(value));
  }

  #axes(xTitle, yTitle) {
    const { left, top, width, height } = this.box;
    const { x, y } = this.scales;
    let shown = -Infinity;
    for (const tick of x.ticks) {
      const at = this.x(tick);
      this.grid.append(drawn("line", { x1: at, x2: at, y1: top, y2: top + height }));
      const label = x.label(tick);
      if (at - shown < 8 * label.length + 10) continue;
      this.#text(label, at, top + height + 16, "middle");
      shown = at;
    }
    for (const tick of y.ticks) {
      const at = this.y(tick);
      this.grid.append(drawn("line", { x1: left, x2: left + width, y1: at, y2: at }));
      this.#text(y.label(tick), left - 8, at + 4, "end");
    }
    this.#text(xTitle, left + width / 2, top + height + 34, "middle", "title");
    this.#text(yTitle, 0, 12, "start", "title");
  }

  #text(text, x, y, anchor, kind = "tick") {
    const node = drawn("text", { x, y, "text-anchor": anchor, class: kind });
    for (const part of text.split(/(_\w)/)) {
      const below = part.startsWith("_");
      node.append(drawn("tspan", below ? { dy: 3, class: "below" } : {}, below ? part.slice(1) : part));
      if (below) node.append(drawn("tspan", { dy: -3 }, "\u200b"));
    }
    this.svg.append(node);
  }

  line(xs, ys, attributes) {
    let path = "";
    let pen = "M";
    xs.forEach((x, i) => {
      const at = this.y(ys[i]);
      if (!Number.isFinite(at)) return void (pen = "M");
      path += `${pen}${this.x(x).toFixed(1)} ${at.toFixed(1)}`;
      pen = "L";
    });
    const node = drawn("path", { d: path, fill: "none", ...attributes });
    this.marks.append(node);
    return node;
  }

  /** Squares, of which those nearer than `apart` pixels to the one before are left out. */
  points(xs, ys, { size = 3, apart = 0, ...attributes }) {
    let path = "";
    let last = -Infinity;
    xs.forEach((x, i) => {
      const [left, top] = [this.x(x), this.y(ys[i])];
      if (!Number.isFinite(top) || left - last < apart) return;
      path += squarePath(left, top, size);
      last = left;
    });
    const node = drawn("path", { d: path, ...attributes });
    this.marks.append(node);
    return node;
  }
}

export function squarePath(x, y, r) {
  return `M${x.toFixed(1)} ${y.toFixed(1)}m${-r} ${-r}h${2 * r}v${2 * r}h${-2 * r}z`;
}

/** Call `draw` when the size of `holder` changes, once a frame at most. */
export function onResize(holder, draw) {
  let width = holder.clientWidth;
  new ResizeObserver(() => {
    if (holder.clientWidth === width || !holder.clientWidth) return;
    width = holder.clientWidth;
    requestAnimationFrame(draw);
  }).observe(holder);
}
