// Light from all directions: environments made here, people's own images, and the table they are sampled by.
//
// An environment is {width, height, data: Float32Array rgba}, first row up; column u and row v of [0, 1) look along
// (sin(pi v) sin(2 pi u), cos(pi v), -sin(pi v) cos(2 pi u)), y up: the middle of the image is behind the viewer.

import { RadianceFileError, readRadianceFile } from "./radiance_file.js";
import { SCENES } from "./scenes.js";

const HEIGHT = 256;
const MAX_IMAGE_HEIGHT = 512;
/** Mean radiance of an environment: a white wall in it is shown neither black nor burnt out. */
const MEAN_RADIANCE = 0.5;

const luminance = (data, i) => 0.2126 * data[i] + 0.7152 * data[i + 1] + 0.0722 * data[i + 2];
const sineOfRow = (row, height) => Math.sin((Math.PI * (row + 0.5)) / height);

/** Radiance so that its mean over all directions is `target`. */
function normalise({ width, height, data }, target) {
  let sum = 0;
  let weight = 0;
  for (let row = 0; row < height; row++) {
    const sine = sineOfRow(row, height);
    weight += sine * width;
    for (let column = 0; column < width; column++) sum += sine * luminance(data, 4 * (row * width + column));
  }
  if (!(sum > 0)) throw new Error("The image is black: it gives no light.");
  const factor = (target * weight) / sum;
  return { width, height, data: data.map((value, i) => (i % 4 < 3 ? value * factor : 1)) };
}

/** An environment of a name among those of `scenes.js`. */
export function proceduralEnvironment(name) {
  const { radiance, mean = MEAN_RADIANCE } = SCENES[name];
  const [width, height] = [2 * HEIGHT, HEIGHT];
  const data = new Float32Array(4 * width * height);
  for (let row = 0; row < height; row++) {
    const theta = (Math.PI * (row + 0.5)) / height;
    for (let column = 0; column < width; column++) {
      const phi = (2 * Math.PI * (column + 0.5)) / width;
      const direction = [Math.sin(theta) * Math.sin(phi), Math.cos(theta), -Math.sin(theta) * Math.cos(phi)];
      data.set(radiance(direction), 4 * (row * width + column));
    }
  }
  return normalise({ width, height, data }, mean);
}

const toLinear = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);
const LINEAR_OF_BYTE = Float32Array.from({ length: 256 }, (_, i) => toLinear(i / 255));

/** Pixels of an ImageBitmap as linear radiance, no larger than needed. */
function bitmapEnvironment(image) {
  const height = Math.min(image.height, MAX_IMAGE_HEIGHT);
  const width = Math.max(1, Math.round((image.width * height) / image.height));
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  context.drawImage(image, 0, 0, width, height);
  const data = Float32Array.from(
    context.getImageData(0, 0, width, height).data,
    (byte) => LINEAR_OF_BYTE[byte],
  );
  return { width, height, data };
}

/** Linear rgb pixels, averaged over whole blocks until there are no more than needed. */
function pixelEnvironment({ width, height, data }) {
  const step = Math.max(1, Math.ceil(height / MAX_IMAGE_HEIGHT));
  const [columns, rows] = [Math.floor(width / step), Math.floor(height / step)];
  const result = new Float32Array(4 * columns * rows);
  for (let i = 0; i < columns * rows; i++) {
    const [x, y] = [(i % columns) * step, Math.floor(i / columns) * step];
    for (let block = 0; block < step * step; block++) {
      const from = 3 * ((y + Math.floor(block / step)) * width + x + (block % step));
      for (let c = 0; c < 3; c++) result[4 * i + c] += data[from + c] / (step * step);
    }
  }
  return { width: columns, height: rows, data: result };
}

/** What setEnvironmentImage takes as an environment: an ImageBitmap, or {width, height, data: linear rgb}. */
export function imageEnvironment(image) {
  return normalise(image.data ? pixelEnvironment(image) : bitmapEnvironment(image), MEAN_RADIANCE);
}

/**
 * An image file (jpg, png, webp, or hdr of Radiance) as what setEnvironmentImage takes.
 * Rejects with an Error whose message is for people.
 */
export async function readEnvironment(file) {
  if (/\.(hdr|pic|rgbe)$/i.test(file.name)) {
    try {
      return readRadianceFile(new Uint8Array(await file.arrayBuffer()));
    } catch (error) {
      if (error instanceof RadianceFileError)
        throw new Error(`${file.name}: ${error.message}`, { cause: error });
      throw error;
    }
  }
  try {
    return await createImageBitmap(file);
  } catch (error) {
    throw new Error(`${file.name}: not an image this browser reads. Take a jpg, png, webp or hdr file.`, {
      cause: error,
    });
  }
}

/** Weights of texels: luminance, spread to neighbours as interpolation does, times the sine of the row. */
function texelWeights({ width, height, data }) {
  const blurred = new Float64Array(width * height);
  const across = new Float64Array(width * height);
  for (let i = 0; i < across.length; i++) {
    const row = i - (i % width);
    for (const step of [-1, 0, 1]) across[i] += luminance(data, 4 * (row + ((i + step + width) % width)));
  }
  for (let row = 0; row < height; row++) {
    const sine = sineOfRow(row, height);
    for (const near of [row - 1, row, row + 1]) {
      const from = Math.min(Math.max(near, 0), height - 1) * width;
      for (let column = 0; column < width; column++)
        blurred[row * width + column] += sine * across[from + column];
    }
  }
  return blurred;
}

/** Shares before each of the weights, in single precision, and 1 at the end. */
function sharesBefore(weights) {
  const before = new Float32Array(weights.length + 1);
  const total = weights.reduce((sum, weight) => sum + weight, 0);
  let sum = 0;
  weights.forEach((weight, i) => {
    before[i] = total > 0 ? sum / total : i / weights.length;
    sum += weight;
  });
  before[weights.length] = 1;
  return before;
}

/**
 * The table that an environment is sampled by: of each texel the share of its row before it, the share of the rows
 * before its own, and the density over (u, v). Densities are those of the rounded shares, so that they are exact.
 */
export function samplingTable(environment) {
  const { width, height } = environment;
  const weights = texelWeights(environment);
  const table = new Float32Array(4 * width * height);
  const rows = Array.from({ length: height }, (_, row) => weights.subarray(row * width, (row + 1) * width));
  const beforeRow = sharesBefore(rows.map((row) => row.reduce((sum, weight) => sum + weight, 0)));
  rows.forEach((row, y) => {
    const before = sharesBefore(row);
    const ofRow = (beforeRow[y + 1] - beforeRow[y]) * height;
    for (let x = 0; x < width; x++) {
      table.set([before[x], beforeRow[y], ofRow * (before[x + 1] - before[x]) * width], 4 * (y * width + x));
    }
  });
  return table;
}
