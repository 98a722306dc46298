// Environments made by formula: radiance [r, g, b] of a unit direction, y up, the viewer on the side of z > 0.

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((value) => value / Math.hypot(...a));
const clamp = (x) => Math.min(Math.max(x, 0), 1);
const smooth = (from, to, x) => {
  const t = clamp((x - from) / (to - from));
  return t * t * (3 - 2 * t);
};
const mix = (a, b, t) => a.map((value, i) => value + (b[i] - value) * t);
const scale = (a, factor) => a.map((value) => value * factor);
const add = (a, b) => a.map((value, i) => value + b[i]);

/** 1 inside [-half, half], 0 outside, with an edge as wide as two texels of the image. */
const inside = (x, half) => 1 - smooth(half - 0.015, half + 0.015, Math.abs(x));

/** A rectangle that faces the sphere: share of it that a direction meets, brighter in its middle. */
function softBox(toward, halfWidth, halfHeight) {
  const axis = unit(toward);
  const right = unit(cross(Math.abs(axis[1]) > 0.9 ? [0, 0, 1] : [0, 1, 0], axis));
  const up = cross(axis, right);
  return (direction) => {
    const along = dot(direction, axis);
    if (along <= 0.1) return 0;
    const [x, y] = [dot(direction, right) / along, dot(direction, up) / along];
    const vignette = 1 - 0.35 * ((x / halfWidth) ** 2 + (y / halfHeight) ** 2) * 0.5;
    return inside(x, halfWidth) * inside(y, halfHeight) * Math.max(vignette, 0);
  };
}

const key = softBox([-0.75, 0.65, 0.65], 0.42, 0.42);
const strip = softBox([0.95, 0.25, 0.1], 0.14, 0.75);
const overhead = softBox([0.15, 1, -0.35], 0.5, 0.3);

function softBoxes(direction) {
  const room = mix([0.045, 0.043, 0.042], [0.11, 0.115, 0.12], smooth(-0.6, 0.9, direction[1]));
  return [
    [key, [9, 8.8, 8.4]],
    [strip, [5.4, 5.8, 6.4]],
    [overhead, [4, 4, 4]],
  ].reduce((sum, [box, light]) => add(sum, scale(light, box(direction))), room);
}

const SUN = unit([-0.55, 0.6, 0.58]);

function sky(direction) {
  const height = direction[1];
  const angle = Math.acos(clamp(dot(direction, SUN)));
  const glow = 26 * Math.exp(-((angle / 0.05) ** 2)) + 1.6 * Math.exp(-angle / 0.22);
  const air = mix([0.85, 0.9, 0.95], [0.2, 0.36, 0.72], smooth(-0.1, 0.8, Math.max(height, 0)));
  const ground = mix([0.2, 0.185, 0.16], [0.1, 0.095, 0.085], smooth(0, 0.7, -height));
  return mix(ground, add(air, scale([1, 0.93, 0.82], glow)), smooth(-0.012, 0.012, height));
}

/** Where a ray from the middle of a room meets its walls: the axis of the wall, and the point. */
function meetRoom(direction, halfSize) {
  const steps = direction.map((value, i) => halfSize[i] / Math.max(Math.abs(value), 1e-9));
  const step = Math.min(...steps);
  return { axis: steps.indexOf(step), point: scale(direction, step) };
}

const ROOM = [2.4, 1.5, 3];

/** Three by two panes in the wall on the left. */
function panes(point) {
  const [across, up] = [(point[2] - 0.6) / 0.62, (point[1] - 0.25) / 0.5];
  const bar = (x, count) => {
    const place = x + count / 2;
    if (place < 0 || place > count) return 0;
    const within = Math.abs(place - Math.floor(place) - 0.5);
    return 1 - smooth(0.42, 0.46, within);
  };
  return bar(across, 3) * bar(up, 2);
}

function windowRoom(direction) {
  const { axis, point } = meetRoom(direction, ROOM);
  const distance = Math.hypot(point[0] + ROOM[0], point[1] - 0.2, point[2] - 0.6);
  const daylight = 0.9 / (1 + 0.35 * distance * distance) + 0.05;
  if (axis === 1 && point[1] < 0)
    return scale([0.42, 0.27, 0.16], daylight * (0.8 + 0.2 * Math.cos(12 * point[2]) ** 8));
  if (axis === 1) return scale([0.75, 0.74, 0.7], daylight);
  const wall = scale([0.66, 0.58, 0.47], daylight * (point[1] < -1.35 ? 0.6 : 1));
  if (axis !== 0 || point[0] > 0) return wall;
  const outside = mix([5.2, 5.8, 5.4], [9.5, 10.4, 12], smooth(-0.5, 1, point[1]));
  return mix(wall, outside, panes(point));
}

function gradient(direction) {
  const light = mix(
    [0.1, 0.1, 0.13],
    [1.25, 1.2, 1.1],
    smooth(-0.9, 0.95, 0.8 * direction[1] - 0.3 * direction[0]),
  );
  return add(light, scale([0.5, 0.32, 0.18], Math.exp(-((direction[1] / 0.25) ** 2))));
}

const LAMP = unit([-0.5, 0.5, 0.70711]);

function darkRoom(direction) {
  const angle = Math.acos(clamp(dot(direction, LAMP)));
  return add([0.02, 0.02, 0.022], scale([1, 0.97, 0.92], 600 * (1 - smooth(0.09, 0.12, angle))));
}

/** The mean radiance of the dark room gives a wall that faces its lamp the light that the point light gives. */
export const SCENES = {
  "soft-boxes": { radiance: softBoxes },
  sky: { radiance: sky },
  window: { radiance: windowRoom },
  gradient: { radiance: gradient },
  "dark-room": { radiance: darkRoom, mean: 0.25 },
};
