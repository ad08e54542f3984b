// @ts-check
/** Ways to move the viewpoint: a pointer, keys, the device as it is tilted, a tour. */
/** @typedef {import("./page.js").Stage} Stage */

const CLICK = 4; // pixels: a pointer that moves less has clicked
const TILT = 20; // degrees from the middle to the outermost views
const ROUND = 6000; // milliseconds of a tour around the light field
const STILL = ROUND / 8; // between the places of a tour for those who asked for less motion
const KEYS = { ArrowUp: [-0.5, 0], ArrowDown: [0.5, 0], ArrowLeft: [0, -0.5], ArrowRight: [0, 0.5] };

/**
 * A drag moves the viewpoint, so that near things follow the hand; a click calls `choose` with a place, 0 to 1 from the top left.
 * @param {Stage} stage
 * @param {(x: number, y: number) => void} choose
 */
export function followPointer({ canvas, lightField, tour, move }, choose) {
  canvas.addEventListener("pointerdown", (event) => {
    if (!event.isPrimary) return;
    tour.checked = false;
    const ended = new AbortController();
    const from = [event.clientX, event.clientY];
    let last = from;
    const drag = (/** @type {PointerEvent} */ { clientX, clientY, pointerId }) => {
      if (pointerId !== event.pointerId) return;
      const { width, height } = canvas.getBoundingClientRect();
      move((-(clientY - last[1]) * lightField.rows) / height, (-(clientX - last[0]) * lightField.cols) / width);
      last = [clientX, clientY];
    };
    const end = (/** @type {PointerEvent} */ { clientX, clientY, pointerId, type }) => {
      if (pointerId !== event.pointerId) return;
      ended.abort();
      const { left, top, width, height } = canvas.getBoundingClientRect();
      if (type === "pointerup" && Math.hypot(clientX - from[0], clientY - from[1]) < CLICK) {
        choose((clientX - left) / width, (clientY - top) / height);
      }
    };
    canvas.setPointerCapture(event.pointerId);
    canvas.addEventListener("pointermove", drag, ended);
    canvas.addEventListener("pointerup", end, ended);
    canvas.addEventListener("pointercancel", end, ended); // the browser took the touch, to scroll for example
  });
}

/**
 * Arrow keys move the viewpoint by half a view.
 * @param {Stage} stage
 */
export function followKeys({ canvas, tour, move }) {
  canvas.addEventListener("keydown", (event) => {
    const step = KEYS[/** @type {keyof typeof KEYS} */ (event.key)];
    if (!step || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    tour.checked = false;
    move(step[0], step[1]);
  });
}

/**
 * The picture is a window that the device holds: tilting it from where it is when `tilt` is checked moves the viewpoint.
 * @param {Stage} stage
 * @param {() => void} refuse Called where the user does not permit it.
 */
export function followDevice({ tilt, tour, stopped, moveFromCentre }, refuse) {
  /** @type {[number, number] | undefined} */
  let held;
  const turn = (/** @type {DeviceOrientationEvent} */ { beta, gamma }) => {
    if (!tilt.checked || beta === null || gamma === null) return;
    const angle = (screen.orientation.angle * Math.PI) / 180;
    const across = gamma * Math.cos(angle) + beta * Math.sin(angle);
    const down = beta * Math.cos(angle) - gamma * Math.sin(angle);
    held ??= [down, across];
    tour.checked = false;
    moveFromCentre((held[0] - down) / TILT, (held[1] - across) / TILT);
  };
  tilt.addEventListener("change", async () => {
    held = undefined;
    const asked = /** @type {{requestPermission?: () => Promise<string>}} */ (/** @type {unknown} */ (DeviceOrientationEvent));
    if (!tilt.checked || !asked.requestPermission) return;
    if ((await asked.requestPermission()) === "granted") return;
    tilt.checked = false;
    refuse();
  });
  addEventListener("deviceorientation", turn, stopped);
}

/**
 * While `tour` is checked, the viewpoint goes around the centre; in steps where less motion is asked for.
 * @param {Stage} stage
 */
export function followTour({ tour, stopped, moveFromCentre }) {
  const travel = (/** @type {number} */ time) => {
    if (!tour.checked || stopped.signal.aborted) return;
    const isCalm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    const angle = (2 * Math.PI * (isCalm ? Math.floor(time / STILL) * STILL : time)) / ROUND;
    moveFromCentre(0.8 * Math.sin(angle), 0.8 * Math.cos(angle));
    requestAnimationFrame(travel);
  };
  tour.addEventListener("change", () => tour.checked && requestAnimationFrame(travel));
}
