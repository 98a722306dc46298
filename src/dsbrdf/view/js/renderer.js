// What the graphics device holds and does for a sphere: programs, textures, one more set of samples.

import { createContext, floatTexture, Program, Target } from "./gl.js";

/** Distance of the viewer in radii, and the share of the picture's shorter side that the sphere takes. */
const DISTANCE = 5;
export const COVER = 0.88;
const HALF_WIDTH = 1 / Math.sqrt(DISTANCE * DISTANCE - 1) / COVER;
const FLAT_RADIANCE = 0.5;
const LIGHTING_CODES = { environment: 0, "dark-room": 0, flat: 1, point: 2 };
const EVALUATE_WIDTH = 1024;

/** Throws an Error for people where the browser or the device cannot do it. */
export class Renderer {
  constructor(canvas, shaders) {
    this.canvas = canvas;
    this.gl = createContext(canvas);
    this.source = (name) => ["constants", "texture", "dsbrdf", name].map((part) => shaders[part]).join("\n");
    this.sphere = new Program(this.gl, this.source("sphere"));
    this.picture = new Program(this.gl, shaders.show);
    this.halves = [{}, {}];
    this.light = {};
    this.targets = [];
    this.fence = null;
    this.samples = 0;
    this.band = 0;
    this.allocate();
  }

  /** Whether programs are compiled, and the device is done with what it was given. */
  ready() {
    const { gl, fence } = this;
    if (fence && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) return false;
    return this.sphere.ready() && this.picture.ready();
  }

  /** Begin anew, with as many pixels as the canvas has, or one for `coarseness` in each direction. */
  allocate(coarseness = 1) {
    const [width, height] = [this.canvas.width, this.canvas.height].map((side) => Math.ceil(side / coarseness));
    if (this.targets[0]?.width !== width || this.targets[0]?.height !== height) {
      for (const target of this.targets) target.delete();
      this.targets = [0, 1].map(() => new Target(this.gl, width, height));
    }
    this.clear();
  }

  clear() {
    this.targets[0].clear();
    this.samples = 0;
    this.band = 0;
  }

  #texture(image, smooth = false) {
    return image && floatTexture(this.gl, image.width, image.height, image.data, smooth);
  }

  /** Numbers of the left (0) or right (1) half, as `pack.js` packs them; `profile` is null but for measured ones. */
  setMaterial(slot, parameters, profile) {
    const half = this.halves[slot];
    for (const texture of Object.values(half)) this.gl.deleteTexture(texture);
    Object.assign(half, { parameters: this.#texture(parameters), profile: this.#texture(profile) });
  }

  /** Light from all directions, and the table it is sampled by. */
  setLight({ width, height, data }, table) {
    for (const texture of Object.values(this.light)) this.gl.deleteTexture(texture);
    this.light = {
      environment: this.#texture({ width, height, data }, true),
      table: this.#texture({ width, height, data: table }),
    };
  }

  /**
   * Add `nPairs` samples to each pixel, or to those of the next of `nBands` bands of rows; they count when all have
   * them. Rotations are those of `rotation.js`. Returns whether all have them.
   */
  accumulate({ camera, toEnvironment, pointLight, lighting, nPairs, isSplit, nBands = 1 }) {
    const { gl } = this;
    const [from, to] = this.targets;
    const uniforms = {
      u_sum: from.texture,
      u_environment: this.light.environment,
      u_light: this.light.table,
      u_camera: camera,
      u_to_environment: toEnvironment,
      u_point_light: pointLight,
      u_resolution: [to.width, to.height],
      u_distance: DISTANCE,
      u_half_width: HALF_WIDTH,
      u_flat: FLAT_RADIANCE,
      u_lighting: LIGHTING_CODES[lighting],
      u_n_pairs: nPairs,
      u_n_before: this.samples,
    };
    if (nBands !== this.nBands) Object.assign(this, { nBands, band: 0 });
    const [bottom, top] = [this.band, this.band + 1].map((edge) => Math.floor((to.height * edge) / nBands));
    const middle = isSplit ? Math.floor(to.width / 2) : to.width;
    to.bind();
    gl.enable(gl.SCISSOR_TEST);
    for (const [slot, left, right] of [
      [0, 0, middle],
      [1, middle, to.width],
    ]) {
      if (left === right) continue;
      const { parameters, profile } = this.halves[slot];
      gl.scissor(left, bottom, right - left, top - bottom);
      this.sphere.draw({
        ...uniforms,
        u_parameters: parameters,
        u_profile: profile,
        u_measured: profile ? 1 : 0,
      });
    }
    gl.disable(gl.SCISSOR_TEST);
    if (this.fence) gl.deleteSync(this.fence);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.band = (this.band + 1) % nBands;
    if (this.band > 0) {
      gl.flush();
      return false;
    }
    this.targets = [to, from];
    this.samples += nPairs;
    return true;
  }

  /** The mean of the samples on the canvas, times `exposure`. */
  show(exposure) {
    const { gl, canvas } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, canvas.width, canvas.height);
    const scale = this.targets[0].height / canvas.height;
    this.picture.draw({ u_sum: this.targets[0].texture, u_exposure: exposure, u_scale: scale });
    gl.flush();
  }

  /** Mean radiance of each pixel: {width, height, data: Float32Array rgb}, first row on top. */
  pixels() {
    const { width, height } = this.targets[0];
    const read = this.targets[0].read();
    const data = new Float32Array(3 * width * height);
    for (let i = 0; i < width * height; i++) {
      const from = 4 * ((height - 1 - Math.floor(i / width)) * width + (i % width));
      for (let c = 0; c < 3; c++) data[3 * i + c] = read[from + c] / Math.max(read[from + 3], 1);
    }
    return { width, height, data };
  }

  /** Values (n, 3) of the material of a half at pairs (n, 6) of directions. */
  evaluate(pairs, slot) {
    const n = pairs.length / 6;
    const [width, height] = [EVALUATE_WIDTH, Math.ceil(n / EVALUATE_WIDTH)];
    const data = new Float32Array(8 * width * height);
    for (let i = 0; i < 2 * n; i++) data.set(pairs.subarray(3 * i, 3 * i + 3), 4 * i);
    const input = floatTexture(this.gl, 2 * width, height, data);
    const target = new Target(this.gl, width, height);
    this.evaluation ??= new Program(this.gl, this.source("evaluate"));
    this.evaluation.draw({ u_pairs: input, u_parameters: this.halves[slot].parameters });
    const read = target.read();
    this.gl.deleteTexture(input);
    target.delete();
    return Float32Array.from({ length: 3 * n }, (_, i) => read[4 * Math.floor(i / 3) + (i % 3)]);
  }

  delete() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }
}
