// @ts-check
/** The page around a viewer: drag, arrow keys, sliders, a tour that stops at a touch; the address holds what is shown. */
import { LightFieldViewer } from "./viewer.js";

/** @import { LightField } from "./viewer.js" */

/**
 * Starts the viewer in the elements of `viewer.html`.
 * @param {LightField} lightField
 */
export async function start(lightField) {
  const canvas = /** @type {HTMLCanvasElement} */ (document.querySelector("canvas"));
  const status = /** @type {HTMLElement} */ (document.querySelector("[role=status]"));
  const focus = /** @type {HTMLInputElement} */ (document.querySelector("#focus"));
  const aperture = /** @type {HTMLInputElement} */ (document.querySelector("#aperture"));
  const tour = /** @type {HTMLInputElement} */ (document.querySelector("#tour"));
  /** @type {LightFieldViewer} */
  let viewer;
  try {
    viewer = new LightFieldViewer(canvas, lightField);
    await viewer.load((done, total) => (status.textContent = `Loading view ${done} of ${total}`));
  } catch (error) {
    status.textContent = error instanceof Error ? error.message : String(error);
    return;
  }
  canvas.style.setProperty("--ratio", String(lightField.width / lightField.height));
  const sign = lightField.depthSense === "lenses" ? -1 : 1; // so that the slider's right end is near
  const middle = viewer.measureDisparity() ?? 0;
  const range = Math.max(2, Math.min(lightField.width / 16, 32));
  const given = new URLSearchParams(location.hash.slice(1));
  const read = (/** @type {string} */ name, /** @type {number} */ otherwise) => Number(given.get(name) ?? otherwise) || 0;
  focus.min = String(sign * middle - range);
  focus.max = String(sign * middle + range);
  aperture.max = String(Math.max(lightField.rows, lightField.cols) / 2);
  viewer.disparity = read("focus", middle);
  viewer.aperture = read("aperture", 0);
  viewer.move(read("v", viewer.viewpoint[0]) - viewer.viewpoint[0], read("u", viewer.viewpoint[1]) - viewer.viewpoint[1]);
  focus.value = String(sign * viewer.disparity);
  aperture.value = String(viewer.aperture);

  let isQueued = false;
  let settled = 0;
  const show = () => {
    if (!isQueued) requestAnimationFrame(() => ((isQueued = false), viewer.draw(true)));
    isQueued = true;
    clearTimeout(settled);
    settled = setTimeout(settle, 200);
    const [v, u] = viewer.viewpoint;
    status.textContent = `View ${v.toFixed(1)}, ${u.toFixed(1)}. Focus ${viewer.disparity.toFixed(1)} pixels a view.`;
  };
  const settle = () => {
    viewer.draw();
    const place = { v: viewer.viewpoint[0], u: viewer.viewpoint[1], focus: viewer.disparity, aperture: viewer.aperture };
    const texts = Object.entries(place).map(([name, value]) => `${name}=${Number(value.toFixed(3))}`);
    history.replaceState(null, "", `#${texts.join("&")}`);
  };
  const move = (/** @type {number} */ v, /** @type {number} */ u) => {
    viewer.move(v, u);
    show();
  };

  focus.addEventListener("input", () => ((viewer.disparity = sign * Number(focus.value)), show()));
  aperture.addEventListener("input", () => ((viewer.aperture = Number(aperture.value)), show()));
  canvas.addEventListener("pointerdown", (event) => {
    tour.checked = false;
    const from = [event.clientX, event.clientY];
    let last = from;
    const drag = (/** @type {PointerEvent} */ moved) => {
      const { width, height } = canvas.getBoundingClientRect();
      move(
        (-sign * (moved.clientY - last[1]) * lightField.rows) / height,
        (-sign * (moved.clientX - last[0]) * lightField.cols) / width,
      );
      last = [moved.clientX, moved.clientY];
    };
    const end = (/** @type {PointerEvent} */ up) => {
      canvas.removeEventListener("pointermove", drag);
      if (Math.hypot(up.clientX - from[0], up.clientY - from[1]) < 4) focusOn(up);
    };
    canvas.setPointerCapture(event.pointerId);
    canvas.addEventListener("pointermove", drag);
    canvas.addEventListener("pointerup", end, { once: true });
  });
  const focusOn = (/** @type {PointerEvent} */ event) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const found = viewer.measureDisparity((event.clientX - left) / width, (event.clientY - top) / height);
    if (found === null) {
      status.textContent = "Nothing there shows its depth; click an edge or a pattern.";
      return;
    }
    viewer.disparity = found;
    focus.value = String(sign * found);
    show();
  };
  const keys = { ArrowUp: [-1, 0], ArrowDown: [1, 0], ArrowLeft: [0, -1], ArrowRight: [0, 1] };
  canvas.addEventListener("keydown", (event) => {
    const step = keys[/** @type {keyof typeof keys} */ (event.key)];
    if (!step) return;
    event.preventDefault();
    tour.checked = false;
    move(sign * step[0] * 0.5, sign * step[1] * 0.5);
  });
  const travel = (/** @type {number} */ time) => {
    if (!tour.checked) return;
    const angle = (2 * Math.PI * time) / 6000;
    viewer.viewpoint = [
      ((lightField.rows - 1) / 2) * (1 + 0.8 * Math.sin(angle)),
      ((lightField.cols - 1) / 2) * (1 + 0.8 * Math.cos(angle)),
    ];
    viewer.draw(true);
    requestAnimationFrame(travel);
  };
  tour.addEventListener("change", () => (tour.checked ? requestAnimationFrame(travel) : show()));
  show();
  if (tour.checked) requestAnimationFrame(travel);
}
