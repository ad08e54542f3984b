// @ts-check
/** Zooms and pans a picture by dragging, wheel, pinch and keys. */

const STEP = 0.5; // of a key, in doublings
const NOTCH = 400; // pixels of the wheel that double the zoom
const SHARE = 0.25; // of the visible part, by which an arrow key moves it
const KEYS = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] });
const ZOOM_KEYS = /** @type {Record<string, number>} */ ({ "+": STEP, "=": STEP, "-": -STEP, 0: -Infinity });

/**
 * Starts listening to events. The result is in the style properties `--zoom`, a factor, and `--x` and `--y`, where the picture begins.
 * @param {HTMLElement} element The element with the picture.
 * @param {HTMLInputElement} slider The zoom in doublings, from 0.
 * @param {() => void} changed Called when another part of the picture is shown.
 * @returns {() => void} Updates the picture after the slider's range has changed.
 */
export function followGestures(element, slider, changed = () => {}) {
  /** The shares of the picture to the left of the visible part and above it. */
  const start = [0, 0];
  /** @type {Map<number, number[]>} The places of the pointers that are down. */
  const pointers = new Map();
  let doublings = 0;

  const place = () => {
    const zoom = 2 ** doublings;
    for (const axis of [0, 1]) start[axis] = Math.min(Math.max(start[axis], 0), 1 - 1 / zoom);
    for (const [name, value] of Object.entries({ "--zoom": zoom, "--x": `${-100 * start[0]}%`, "--y": `${-100 * start[1]}%` })) {
      element.style.setProperty(name, String(value));
    }
    changed();
  };
  const pan = (/** @type {number[]} */ shares) => {
    for (const axis of [0, 1]) start[axis] += shares[axis] / 2 ** doublings;
    place();
  };
  /** Zooms; the spot at `shares` of the frame stays where it is. */
  const zoomTo = (/** @type {number} */ wanted, shares = [0.5, 0.5]) => {
    const before = 2 ** -doublings;
    doublings = Math.min(Math.max(wanted, 0), Number(slider.max));
    for (const axis of [0, 1]) start[axis] += shares[axis] * (before - 2 ** -doublings);
    slider.value = String(doublings);
    place();
  };
  const locate = (/** @type {MouseEvent} */ { clientX, clientY }) => {
    const { left, top, width, height } = element.getBoundingClientRect();
    return [(clientX - left) / width, (clientY - top) / height];
  };

  slider.addEventListener("input", () => zoomTo(Number(slider.value)));
  element.addEventListener("wheel", (event) => {
    if (event.deltaY > 0 && doublings === 0) return; // the page scrolls
    event.preventDefault();
    zoomTo(doublings - event.deltaY / NOTCH, locate(event));
  });
  element.addEventListener("keydown", (event) => {
    const way = KEYS[event.key], step = ZOOM_KEYS[event.key];
    if (event.ctrlKey || event.metaKey || event.altKey || !(way || step)) return;
    event.preventDefault();
    if (way) pan(way.map((each) => SHARE * each));
    else zoomTo(doublings + step);
  });
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, locate(event));
  });
  element.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = measureSpread([...pointers.values()]);
    pointers.set(event.pointerId, locate(event));
    const after = measureSpread([...pointers.values()]);
    if (before.spread && after.spread) zoomTo(doublings + Math.log2(after.spread / before.spread), after.middle);
    pan([0, 1].map((axis) => before.middle[axis] - after.middle[axis]));
  });
  for (const end of /** @type {const} */ (["pointerup", "pointercancel"])) {
    element.addEventListener(end, ({ pointerId }) => pointers.delete(pointerId));
  }
  return place;
}

/**
 * Returns the middle of places, and the distance between two of them, or 0 for a single one.
 * @param {number[][]} places
 */
function measureSpread(places) {
  const middle = [0, 1].map((axis) => places.reduce((sum, place) => sum + place[axis], 0) / places.length);
  const [first, last] = [places[0], places[places.length - 1]];
  return { middle, spread: Math.hypot(last[0] - first[0], last[1] - first[1]) };
}
