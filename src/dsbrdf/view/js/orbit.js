// Turning the sphere's view and light by dragging and by the arrow keys.

const RADIANS_PER_PIXEL = 0.008;
const RADIANS_PER_KEY = 0.1;
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

/**
 * Dragging, or an arrow key, turns what mode() says, "view" or "light"; with shift or the right button, the light.
 * The view moves so that what is under the pointer follows it.
 */
export function orbit(canvas, sphere, { mode = () => "view" } = {}) {
  let last = null;
  const turn = (event, light, right, up) => {
    event.preventDefault();
    if (light || mode() === "light") sphere.rotateLight(right, up);
    else sphere.rotateView(-right, -up);
  };
  canvas.style.touchAction = "none";
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    last = event;
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!last || event.pointerId !== last.pointerId) return;
    const light = event.shiftKey || (event.buttons & 2) !== 0;
    const [right, up] = [event.clientX - last.clientX, last.clientY - event.clientY];
    turn(event, light, right * RADIANS_PER_PIXEL, up * RADIANS_PER_PIXEL);
    last = event;
  });
  for (const type of ["pointerup", "pointercancel"]) canvas.addEventListener(type, () => (last = null));
  canvas.addEventListener("keydown", (event) => {
    const step = KEYS[event.key];
    if (step) turn(event, event.shiftKey, step[0] * RADIANS_PER_KEY, step[1] * RADIANS_PER_KEY);
  });
}
