// Small pictures of materials: two distant lights, those of dsbrdf.model.sphere, in a bright room.

import { asRgb, evaluate } from "./material.js";
import { meta } from "./meta.js";

const length = (vector) => Math.hypot(...vector);
const unit = (vector) => vector.map((component) => component / length(vector));
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** The viewer is far away along +z, so that theta_d is the same all over the sphere. */
const LIGHTS = meta.lights.map(([toward, irradiance]) => {
  const light = unit(toward);
  const sum = [light[0], light[1], light[2] + 1];
  return { light, irradiance, half: unit(sum), cosD: length(sum) / 2 };
});
/** Shares of the lights and of the room, which makes metals seen. */
const LIT = 0.6;
const ROOM = 0.4;
const N_THETA_H = 64;
/** Radians from the normal at which the room is seen. */
const ROOM_ANGLE = Math.PI / 6;
const display = (value) => 255 * Math.min(1, value) ** (1 / 2.2);

/** Colours across and along the plane of incidence at even steps of the square root of theta_h. */
function tabulate(model, { cosD }) {
  const thetaD = Math.acos(Math.min(1, cosD));
  return [-1, 1].map((cos2Phi) =>
    Array.from({ length: N_THETA_H }, (_, i) =>
      asRgb(model, evaluate(model, (Math.PI / 2) * (i / (N_THETA_H - 1)) ** 2, thetaD, cos2Phi)),
    ),
  );
}

/** Radiance of a point of the sphere under one light, added to `radiance`. */
function addLight(radiance, normal, [across, along], { light, irradiance, half, cosD }) {
  const cosI = dot(normal, light);
  if (cosI <= 0) return;
  const cosH = Math.min(1, dot(normal, half));
  const sines = Math.sqrt((1 - cosH * cosH) * (1 - cosD * cosD));
  const share = sines > 1e-9 ? Math.min(1, ((cosH * cosD - cosI) / sines) ** 2) : 0.5;
  const at = Math.sqrt(Math.acos(cosH) / (Math.PI / 2)) * (N_THETA_H - 1);
  const low = Math.min(Math.floor(at), N_THETA_H - 2);
  for (let c = 0; c < 3; c++) {
    const lower = across[low][c] + share * (along[low][c] - across[low][c]);
    const upper = across[low + 1][c] + share * (along[low + 1][c] - across[low + 1][c]);
    radiance[c] += irradiance * cosI * (lower + (at - low) * (upper - lower));
  }
}

/** theta_h and weights of a few nodes, denser toward the pole; beyond, what is reflected goes below the horizon. */
const FEW_NODES = Array.from({ length: 8 }, (_, i) => {
  const u = (i + 0.5) / 8;
  const thetaH = (Math.PI / 4) * u * u;
  const solidAngle = 2 * Math.PI * Math.sin(thetaH) * (Math.PI / 4) * 2 * u * (1 / 8);
  return { thetaH, weight: solidAngle * 4 * Math.cos(ROOM_ANGLE) * Math.cos(2 * thetaH) };
});

/** About the albedo in red, green and blue, of the values at one theta_d. */
function roomColour(model) {
  const total = new Float64Array(model.nChannels);
  for (const { thetaH, weight } of FEW_NODES) {
    evaluate(model, thetaH, ROOM_ANGLE, 0).forEach((value, c) => (total[c] += weight * value));
  }
  return asRgb(model, total);
}

/** The colour of a material as a point. */
export const pointColour = (model) => `rgb(${roomColour(model).map(display).map(Math.round).join()})`;

/** A picture of a material as a sphere, `size` pixels wide; a perfect diffuser is white. */
export function chipImage(model, size) {
  const room = roomColour(model).map((value) => (ROOM * value) / (LIT * Math.PI));
  const tables = LIGHTS.map((light) => tabulate(model, light));
  const image = new ImageData(size, size);
  const radiance = new Float64Array(3);
  for (let i = 0; i < size * size; i++) {
    const x = (2 * ((i % size) + 0.5)) / size - 1;
    const y = 1 - (2 * (Math.floor(i / size) + 0.5)) / size;
    const z2 = 1 - x * x - y * y;
    if (z2 <= 0) continue;
    radiance.set(room);
    LIGHTS.forEach((light, j) => addLight(radiance, [x, y, Math.sqrt(z2)], tables[j], light));
    for (let c = 0; c < 3; c++) image.data[4 * i + c] = display(LIT * Math.PI * radiance[c]);
    image.data[4 * i + 3] = 255;
  }
  return image;
}

/** `chipImage` on a canvas. */
export function drawChip(canvas, model, size) {
  canvas.width = canvas.height = size;
  canvas.getContext("2d").putImageData(chipImage(model, size), 0, 0);
}
