// A sphere of a material under an environment, rendered progressively with WebGL2.
//
//   const sphere = new Sphere(canvas, shaders, { onError, onProgress });
//   sphere.setMaterials(material); // or (left, right): split down the middle
//   sphere.setEnvironment("soft-boxes");
//   sphere.start();
//
// `shaders` is what dsbrdf.shader.sources() returns in Python: an object of strings, put into the page as JSON.
//
// A material is a model as `material.js` has it, with
//   profile: null or {thetaD, thetaH: Float32Array ((theta_d,) theta_h), radians,
//     mean, amplitude: Float32Array (theta_d, channel, theta_h), NaN where there is none}.
// A copy with `measured: true` is drawn from its profile; where that has no number, near the pole and at grazing
// angles, from its lobes. The document holds the package's constants as JSON in an element called "meta".
//
// Nothing here throws for want of WebGL2: onError(text) is called, and every method then does nothing. The canvas
// may then have no 2d context either: draw what stands in for the sphere on another one.

import { samplingTable, imageEnvironment, proceduralEnvironment } from "./environment.js";
import { packParameters, packProfile } from "./pack.js";
import { COVER, Renderer } from "./renderer.js";
import { apply, column, IDENTITY, multiply, rotation, transpose } from "./rotation.js";

/** Names that setEnvironment takes, and their labels. */
export const ENVIRONMENTS = [
  { name: "soft-boxes", label: "Studio, soft boxes" },
  { name: "sky", label: "Sky with a veiled sun" },
  { name: "window", label: "Room with a window" },
  { name: "gradient", label: "Gradient" },
];

/** Names that setLighting takes, and their labels. */
export const LIGHTINGS = [
  { name: "environment", label: "Environment" },
  { name: "flat", label: "Flat, the same from everywhere" },
  { name: "dark-room", label: "Dark room, one lamp" },
  { name: "point", label: "Point light" },
];

const POINT_LIGHT = [-0.5, 0.5, Math.SQRT1_2];
const MAX_PITCH = 1.5;
const MAX_PAIRS = 16;
const MAX_BANDS = 16;
/** Frames that take less or more, in ms, get more or fewer samples. */
const [SHORT_FRAME, LONG_FRAME] = [25, 60];
/** Pixels across one sample while something is dragged, at most, and ms without a change until it is at rest. */
const MAX_COARSENESS = 4;
const REST = 200;
/** How long a lost device may stay away, in ms, before people are told. */
const PATIENCE = 5000;

export class Sphere {
  /**
   * onError(text): what does not work, in words. onProgress({nSamples, maxSamples}): after each frame.
   * The canvas's own width and height are its pixels; call resize() when they should follow its size on the page.
   */
  constructor(canvas, shaders, { onError = () => {}, onProgress = () => {} } = {}) {
    Object.assign(this, { canvas, shaders, onError, onProgress });
    this.maxSamples = 256;
    this.materials = [];
    this.lighting = "environment";
    this.environment = ENVIRONMENTS[0].name;
    this.environments = new Map();
    this.exposure = 0;
    this.nPairs = 1;
    /** Pixels across one sample: more than one while something is dragged, on a device that needs it. */
    this.coarseness = 1;
    this.draggedCoarseness = MAX_COARSENESS;
    this.changed = -Infinity;
    this.waitUntil = -Infinity;
    /** The picture is drawn in so many bands, one a frame: more than one on a slow device. */
    this.nBands = 1;
    this.duration = 0;
    this.submitted = NaN;
    this.handle = null;
    this.isRunning = false;
    this.resetRotation();
    canvas.addEventListener("webglcontextlost", (event) => this.#lose(event));
    canvas.addEventListener("webglcontextrestored", () => this.#build());
    this.#build();
  }

  /** One material, or two: the left and the right half of the sphere. */
  setMaterials(left, right = null) {
    this.materials = right ? [left, right] : [left];
    this.#drag(() => this.materials.forEach((_, slot) => this.#uploadMaterial(slot)));
  }

  /** A name among ENVIRONMENTS. */
  setEnvironment(name) {
    this.environment = name;
    this.#update(() => this.#uploadLight());
  }

  /**
   * An image over all directions (equirectangular): ImageBitmap, or {width, height, data: Float32Array, linear rgb}.
   * Throws an Error for people if it is black.
   */
  setEnvironmentImage(image) {
    this.environment = imageEnvironment(image);
    this.#update(() => this.#uploadLight());
  }

  /** A name among LIGHTINGS. */
  setLighting(name) {
    this.lighting = name;
    this.#update(() => this.#uploadLight());
  }

  /** In stops; 0 shows radiance 1 as white. Keeps the samples. */
  setExposure(stops) {
    this.exposure = stops;
    this.#guard((renderer) => renderer.show(2 ** this.exposure));
  }

  /** Turn the viewer about the sphere: radians to the right and upward. */
  rotateView(right, up) {
    this.#setView(this.yaw + right, Math.min(Math.max(this.pitch + up, -MAX_PITCH), MAX_PITCH));
    this.#drag();
  }

  /** Turn the light about the sphere as it is seen: radians to the right and upward. */
  rotateLight(right, up) {
    const turned = multiply(rotation(column(this.camera, 1), right), rotation(column(this.camera, 0), -up));
    this.lightRotation = multiply(turned, this.lightRotation);
    this.#drag();
  }

  /** View and light back to where they were at first. */
  resetRotation() {
    this.#setView(0, 0);
    this.lightRotation = IDENTITY;
    this.#update();
  }

  /** Match the canvas's pixels to its size on the page, two for each of the page's at most. */
  resize() {
    const ratio = Math.min(devicePixelRatio, 2);
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight].map((side) =>
      Math.round(side * ratio),
    );
    if (!width || !height || (width === this.canvas.width && height === this.canvas.height)) return;
    Object.assign(this.canvas, { width, height });
    this.#update((renderer) => renderer.allocate(this.coarseness));
  }

  /** Draw until there are maxSamples, and again after each change. */
  start() {
    this.isRunning = true;
    this.#schedule();
  }

  /** On a slow device, draw nothing for a moment: something else on the page is in use. */
  giveWay() {
    this.waitUntil = performance.now() + REST;
  }

  stop() {
    this.isRunning = false;
    if (this.handle !== null) cancelAnimationFrame(this.handle);
    this.handle = null;
  }

  /** Add samples to each pixel now, and show them. */
  render() {
    while (this.materials.length && this.renderer && !this.#renderBand(1));
  }

  /** Add samples to one of `nBands` bands of the picture; after the last one, show them and return true. */
  #renderBand(nBands) {
    const isWhole = this.#guard((renderer) => {
      this.submitted = performance.now();
      const options = {
        camera: this.camera,
        toEnvironment: transpose(this.lightRotation),
        pointLight: apply(this.lightRotation, POINT_LIGHT),
        lighting: this.lighting,
        nPairs: Math.max(1, Math.min(this.nPairs, this.maxSamples - renderer.samples)),
        isSplit: this.materials.length === 2,
      };
      if (!renderer.accumulate({ ...options, nBands })) return false;
      renderer.show(2 ** this.exposure);
      return true;
    });
    if (isWhole !== false) this.onProgress({ nSamples: this.nSamples, maxSamples: this.maxSamples });
    return isWhole !== false;
  }

  /** Samples of each pixel so far. */
  get nSamples() {
    return this.renderer?.samples ?? 0;
  }

  /** Mean linear radiance [r, g, b] over the pixels that lie within the sphere. */
  meanPixel() {
    const { width, height, data } = this.pixels();
    const radius = (COVER * Math.min(width, height)) / 2 - 1;
    const sum = [0, 0, 0];
    let count = 0;
    for (let i = 0; i < width * height; i++) {
      const [x, y] = [(i % width) + 0.5 - width / 2, Math.floor(i / width) + 0.5 - height / 2];
      if (x * x + y * y > radius * radius) continue;
      count++;
      for (let c = 0; c < 3; c++) sum[c] += data[3 * i + c];
    }
    return sum.map((value) => value / Math.max(count, 1));
  }

  /** Linear radiance of the picture: {width, height, data: Float32Array rgb}, first row on top. */
  pixels() {
    return this.#guard((renderer) => renderer.pixels()) ?? { width: 0, height: 0, data: new Float32Array(0) };
  }

  /** Values (n, 3), 1/sr, of the material of a half at pairs (n, 6): wi, wo, normal +z. */
  evaluate(pairs, slot = 0) {
    return this.#guard((renderer) => renderer.evaluate(pairs, slot)) ?? new Float32Array(0);
  }

  /** The light in use: {width, height, data: Float32Array rgba}, as `environment.js` has it. */
  environmentPixels() {
    return this.#light().pixels;
  }

  /** Free what the graphics device holds. */
  dispose() {
    this.stop();
    this.renderer?.delete();
    this.renderer = null;
  }

  #build() {
    clearTimeout(this.patience);
    try {
      this.renderer = new Renderer(this.canvas, this.shaders);
    } catch (error) {
      this.onError(error.message);
      return;
    }
    this.#update(() => {
      this.materials.forEach((_, slot) => this.#uploadMaterial(slot));
      this.#uploadLight();
    });
  }

  #lose(event) {
    event.preventDefault();
    if (!this.renderer) return;
    this.renderer = null;
    const text = "The graphics device was reset and did not come back. Reload the page to see the sphere.";
    this.patience = setTimeout(() => this.onError(text), PATIENCE);
  }

  /** Do what needs the renderer, if there is one; what it throws becomes onError, and there is none any more. */
  #guard(action) {
    if (!this.renderer) return undefined;
    try {
      return action(this.renderer);
    } catch (error) {
      this.renderer = null;
      this.onError(error.message);
      return undefined;
    }
  }

  /** Begin the picture anew after a change. */
  #update(change = () => {}) {
    this.#guard((renderer) => {
      change(renderer);
      renderer.clear();
    });
    this.#schedule();
  }

  /** Begin anew after a change: coarsely, where one follows another, until nothing has changed for a while. */
  #drag(change = () => {}) {
    const now = performance.now();
    const isOne = now - this.changed > REST;
    this.changed = now;
    this.waitUntil = -Infinity;
    if (!this.isRunning || isOne) return this.#update(change);
    clearTimeout(this.rest);
    this.rest = setTimeout(() => this.#setCoarseness(1), REST);
    this.#setCoarseness(this.draggedCoarseness, change);
  }

  #setCoarseness(coarseness, change = () => {}) {
    this.coarseness = coarseness;
    this.#update((renderer) => {
      change(renderer);
      renderer.allocate(coarseness);
    });
  }

  #uploadMaterial(slot) {
    const material = this.materials[slot];
    const profile = material.measured ? packProfile(material) : null;
    this.renderer.setMaterial(slot, packParameters(material), profile);
  }

  /** The environment and its table; those with a name are made once. */
  #light() {
    const key = this.lighting === "dark-room" ? "dark-room" : this.environment;
    if (!this.environments.has(key)) {
      const pixels = typeof key === "string" ? proceduralEnvironment(key) : key;
      this.environments.set(key, { pixels, table: samplingTable(pixels) });
    }
    return this.environments.get(key);
  }

  #uploadLight() {
    const { pixels, table } = this.#light();
    this.renderer.setLight(pixels, table);
  }

  /** The camera looks from `yaw` to the right of +z and `pitch` above it; its axes are right, up and back. */
  #setView(yaw, pitch) {
    Object.assign(this, { yaw, pitch });
    this.camera = multiply(rotation([0, 1, 0], yaw), rotation([1, 0, 0], -pitch));
  }

  #schedule() {
    if (this.isRunning && this.renderer && this.handle === null) {
      this.handle = requestAnimationFrame(() => this.#step());
    }
  }

  #step() {
    this.handle = null;
    if (this.nSamples >= this.maxSamples) {
      this.submitted = NaN;
      return;
    }
    const isFine = this.coarseness === 1 && this.nBands > 1;
    if (isFine && performance.now() < this.waitUntil) this.submitted = NaN;
    else if (this.materials.length && this.#guard((renderer) => renderer.ready())) {
      this.duration = Math.max(this.duration, performance.now() - this.submitted);
      if (this.renderer.band === 0) this.#pace();
      this.#renderBand(this.coarseness > 1 ? 1 : this.nBands);
    }
    this.#schedule();
  }

  /**
   * More samples at once on a fast device. On a slow one a band of the picture at once, so that the page answers
   * meanwhile, and larger samples while something is dragged.
   */
  #pace() {
    const { duration } = this;
    this.duration = 0;
    if (duration < SHORT_FRAME) {
      if (this.coarseness > 1) this.draggedCoarseness = Math.max(this.draggedCoarseness / 2, 1);
      else if (this.nBands > 1) this.nBands /= 2;
      else this.nPairs = Math.min(2 * this.nPairs, MAX_PAIRS);
    } else if (duration > LONG_FRAME) {
      if (this.coarseness > 1) this.draggedCoarseness = Math.min(2 * this.draggedCoarseness, MAX_COARSENESS);
      else if (this.nPairs > 1) this.nPairs = Math.floor(this.nPairs / 2);
      else Object.assign(this, { nBands: Math.min(2 * this.nBands, MAX_BANDS), draggedCoarseness: MAX_COARSENESS });
    }
  }
}
