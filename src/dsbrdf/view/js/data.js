// The materials that the page carries: numbers, and names and errors as JSON, all as deflated bytes in base64.

import { SHARED } from "./material.js";
import { meta } from "./meta.js";

async function inflate(id) {
  const text = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Bytes that were sorted by significance, back in the order of the numbers. */
function interleave(planes, width) {
  const count = planes.length / width;
  const bytes = new Uint8Array(planes.length);
  for (let plane = 0; plane < width; plane++) {
    for (let i = 0; i < count; i++) bytes[i * width + plane] = planes[plane * count + i];
  }
  return bytes.buffer;
}

class Reader {
  constructor(numbers) {
    this.numbers = numbers;
    this.at = 0;
  }

  take(count) {
    this.at += count;
    return this.numbers.subarray(this.at - count, this.at);
  }
}

/** Sums along rows: the differences are stored, modulo 2^16. */
function accumulate(differences, rowLength) {
  const values = new Uint16Array(differences.length);
  for (let i = 0; i < values.length; i++) {
    values[i] = (i % rowLength ? values[i - 1] : 0) + differences[i];
  }
  return values;
}

function readProfile(entry, nChannels, floats, words) {
  const [nSlices, nThetaH, nRows] = entry.shape;
  const thetaD = floats.take(nSlices);
  const thetaH = floats.take(nRows * nThetaH);
  const [top] = floats.take(1);
  const count = nSlices * nChannels * nThetaH;
  const levels = accumulate(words.take(count), nThetaH);
  const ratios = new Int16Array(accumulate(words.take(count), nThetaH).buffer);
  const { decades, steps, ratioSteps } = meta.quantised;
  const mean = Float32Array.from(levels, (level) =>
    level ? top * 10 ** (decades * ((level - 1) / (steps - 1) - 1)) : NaN,
  );
  const amplitude = Float32Array.from(ratios, (ratio, i) => (ratio / ratioSteps) * mean[i]);
  return { thetaD, thetaH, nSlices, nThetaH, nChannels, thetaHRows: nRows, mean, amplitude };
}

function readMaterial(entry, kinds, floats, words) {
  const kind = kinds[entry.kind];
  const { lobes: nLobes, channels, sizes } = kind;
  const nChannels = channels.length;
  const shared = SHARED.map((key) => [key, floats.take(nLobes * sizes[key])]);
  const colour = floats.take(nChannels * nLobes * sizes.colour);
  const profile = entry.profile ? readProfile(entry.profile, nChannels, floats, words) : null;
  return { errors: {}, ...entry, ...kind, nLobes, nChannels, ...Object.fromEntries(shared), colour, profile };
}

const floatReader = new Reader(new Float32Array(interleave(await inflate("floats"), 4)));
const wordReader = new Reader(new Uint16Array(interleave(await inflate("words"), 2)));
const described = JSON.parse(new TextDecoder().decode(await inflate("materials")));

/** Of each material its place on the map, x and y in [0, 1], and its coordinates, near in which is alike. */
export const places = [];
if (meta.map) {
  for (const { name } of described.materials) {
    places.push({ name, at: floatReader.take(2), coordinates: floatReader.take(meta.map.coordinates) });
  }
}

export const materials = described.materials.map((entry) =>
  readMaterial(entry, described.kinds, floatReader, wordReader),
);
const indices = new Map(materials.map(({ name }, i) => [name, i]));

/** The index of a material; -1 where there is none. */
export const indexOfMaterial = (name) => indices.get(name) ?? -1;
