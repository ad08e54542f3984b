// @ts-check
/** The elements around a viewer: picture, sliders, tour and status; the address holds what is shown. */
import { followDevice, followKeys, followPointer, followTour } from "./movement.js";
import { VIEWER_TEXTS } from "./texts.js";
import { LightFieldViewer } from "./viewer.js";

/** @typedef {import("./viewer.js").LightField} LightField */

const MARKUP = `<div class="picture"><canvas tabindex="0" role="img" aria-label="${VIEWER_TEXTS.picture}" aria-busy="true"></canvas></div>
<div class="controls">
<label>${VIEWER_TEXTS.far} <input name="focus" type="range" step="0.05" aria-label="${VIEWER_TEXTS.depth}"> ${VIEWER_TEXTS.near}</label>
<label>${VIEWER_TEXTS.aperture} <input name="aperture" type="range" min="0" step="0.1"></label>
<label><input name="tour" type="checkbox"> ${VIEWER_TEXTS.tour}</label>
<label><input name="tilt" type="checkbox"> ${VIEWER_TEXTS.tilt}</label>
<p role="status">${VIEWER_TEXTS.loading}</p>
</div>`;
const REST = 200; // milliseconds after the last move, when the picture is drawn with all views

/** A viewer in an element, with everything that moves it. Load views into `viewer`; then call `begin`, and `show` for each change. */
export class Stage {
  /**
   * @param {HTMLElement} element What is in it is replaced.
   * @param {LightField} lightField
   * @throws {Error} As `LightFieldViewer`.
   */
  constructor(element, lightField) {
    element.innerHTML = MARKUP;
    element.classList.add("light-field");
    const find = (/** @type {string} */ name) => /** @type {HTMLInputElement} */ (element.querySelector(`[name=${name}]`));
    this.element = element;
    this.lightField = lightField;
    this.canvas = /** @type {HTMLCanvasElement} */ (element.querySelector("canvas"));
    this.status = /** @type {HTMLElement} */ (element.querySelector("[role=status]"));
    this.focus = find("focus");
    this.aperture = find("aperture");
    this.tour = find("tour");
    this.tilt = find("tilt");
    this.viewer = new LightFieldViewer(this.canvas, lightField);
    /** Aborted when the stage is closed. */
    this.stopped = new AbortController();
    /** So that larger disparities are nearer, and the right arrow key goes to the right. */
    this.sign = lightField.depthSense === "lenses" ? -1 : 1;
    element.style.setProperty("--ratio", String(lightField.width / lightField.height));
    const label = /** @type {HTMLElement} */ (this.tilt.closest("label"));
    label.hidden = !("DeviceOrientationEvent" in window && matchMedia("(any-pointer: coarse)").matches);
    this.canvas.addEventListener("webglcontextlost", () => {
      if (this.stopped.signal.aborted) return;
      this.close();
      this.status.textContent = VIEWER_TEXTS.lostWebgl;
    });
    this.isQueued = this.hasBegun = false;
    this.settled = 0;
  }

  /** The disparity in focus as all commands have it: in pixels of the views that were read, larger is nearer. */
  get disparity() {
    return (this.sign * this.viewer.disparity) / this.lightField.scale;
  }

  set disparity(disparity) {
    this.viewer.disparity = this.sign * this.lightField.scale * disparity;
  }

  /** Shows what the address names, or the centre, focused on what the whole picture moves by. Call it when there is something to see. */
  begin() {
    const { viewer, focus, aperture, lightField } = this;
    viewer.disparity = viewer.meter.measure() ?? 0;
    const middle = this.disparity;
    const range = Math.max(2, Math.min(lightField.width / 16, 32)) / lightField.scale;
    const given = new URLSearchParams(location.hash.slice(1));
    const read = (/** @type {string} */ name, /** @type {number} */ otherwise) => Number(given.get(name) ?? otherwise) || 0;
    focus.min = String(Math.floor(middle - range)); // whole, for the steps of the slider
    focus.max = String(Math.ceil(middle + range));
    aperture.max = String(Math.max(lightField.rows, lightField.cols) / 2);
    this.disparity = read("focus", middle);
    viewer.aperture = read("aperture", 0);
    viewer.moveTo(read("v", viewer.viewpoint[0]), read("u", viewer.viewpoint[1]));
    focus.value = String(this.disparity);
    aperture.value = String(viewer.aperture);
    focus.addEventListener("input", () => ((this.disparity = Number(focus.value)), this.show()));
    aperture.addEventListener("input", () => ((viewer.aperture = Number(aperture.value)), this.show()));
    followPointer(this, this.focusOn);
    followKeys(this);
    followDevice(this, () => (this.status.textContent = VIEWER_TEXTS.noTilt));
    followTour(this);
    this.hasBegun = true;
    this.show();
  }

  /** Draws in the next frame, and with all views when nothing has moved for a while. */
  show = () => {
    if (!this.isQueued) requestAnimationFrame(this.#draw);
    this.isQueued = true;
    this.canvas.ariaBusy = "true";
    clearTimeout(this.settled);
  };

  /**
   * Moves the viewpoint by views, down and to the right as one sees them.
   * @param {number} down
   * @param {number} across
   */
  move = (down, across) => {
    const [v, u] = this.viewer.viewpoint;
    this.viewer.moveTo(v + this.sign * down, u + this.sign * across);
    this.show();
  };

  /**
   * Moves the viewpoint to a share of the way from the centre to the outermost views, -1 to 1.
   * @param {number} down
   * @param {number} across
   */
  moveFromCentre = (down, across) => {
    const middle = [(this.lightField.rows - 1) / 2, (this.lightField.cols - 1) / 2];
    this.viewer.moveTo(middle[0] * (1 + this.sign * down), middle[1] * (1 + this.sign * across));
    this.show();
  };

  /**
   * Focuses on what is at a place of the picture, 0 to 1 from the top left. The canvas gets an event `choose` with the place.
   * @param {number} x
   * @param {number} y
   */
  focusOn = (x, y) => {
    this.canvas.dispatchEvent(new CustomEvent("choose", { detail: { x, y } }));
    const found = this.viewer.meter.measure(x, y);
    if (found === null) {
      this.status.textContent = VIEWER_TEXTS.flat;
      return;
    }
    this.viewer.disparity = found;
    this.focus.value = String(this.disparity);
    this.show();
  };

  /** Ends all that goes on and frees the memory of the graphics processor. */
  close() {
    this.stopped.abort();
    clearTimeout(this.settled);
    this.viewer.close();
  }

  #draw = (/** @type {number} */ time) => {
    this.isQueued = false;
    if (this.stopped.signal.aborted) return;
    this.viewer.draw(true);
    requestAnimationFrame((next) => this.viewer.adapt(next - time));
    this.settled = setTimeout(this.#settle, REST);
  };

  #settle = () => {
    const { viewer, status, disparity } = this;
    const [v, u] = viewer.viewpoint;
    viewer.draw();
    const shown = new URLSearchParams(location.hash.slice(1));
    for (const [name, value] of Object.entries({ v, u, focus: disparity, aperture: viewer.aperture })) {
      shown.set(name, String(Number(value.toFixed(3))));
    }
    history.replaceState(null, "", `#${shown}`);
    status.textContent = VIEWER_TEXTS.place(v.toFixed(1), u.toFixed(1), disparity.toFixed(2));
    this.canvas.ariaBusy = "false";
    this.canvas.dispatchEvent(new CustomEvent("rest", { bubbles: true }));
  };
}

/**
 * Shows a light field whose views are pictures, row by row.
 * @param {HTMLElement} element
 * @param {LightField & {views: string[]}} lightField With the pictures' addresses.
 */
export async function start(element, lightField) {
  try {
    const stage = new Stage(element, lightField);
    for (const [index, address] of lightField.views.entries()) {
      const picture = new Image();
      picture.src = address;
      await picture.decode();
      stage.viewer.setView(index, picture);
      stage.status.textContent = VIEWER_TEXTS.loadingViews(index + 1, lightField.views.length);
    }
    stage.begin();
  } catch (error) {
    element.textContent = error instanceof Error ? error.message : String(error);
  }
}
