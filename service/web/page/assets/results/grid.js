// @ts-check
/** A lens grid over the picture in which it was found; the user can correct it by dragging. */
import { make } from "../dom.js";
import { HALF, findCentre, findLens, findNearest, isRaw, listDivisors, readShape, sizeOf } from "../input/lenses.js";
import { PICTURE_TEXTS, SENTENCES, TEXTS } from "../texts.js";
import { followGestures } from "./gestures.js";

const NEAREST = 8; // pixels of the screen between lenses that are drawn, at least
const STEP = 0.2; // pixels of the picture for each press of an arrow key
const KEYS = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] });
const RADIUS = 0.42; // of a lens as it is drawn, in pitches
const USUAL_PIXELS = 15; // of an elemental image, if nothing is known

/** @typedef {import("../input/lenses.js").Cells} Cells */
/** @typedef {import("../input/lenses.js").Place} Place */
/** @typedef {import("../input/lenses.js").RawGrid} RawGrid */

/** A picture with its lens grid. */
export class LensGrid {
  /**
   * @param {HTMLElement} element Its content is replaced.
   * @param {HTMLImageElement} image The picture, decoded.
   * @param {(options: Record<string, string>) => void} change Called with the options that result from dragging.
   */
  constructor(element, image, change) {
    this.element = element;
    this.image = image;
    /** @type {Place | undefined} The lens of the first handle. */
    this.anchor = undefined;
    /** @type {Place | undefined} The lens of the second handle, or the corner. */
    this.end = undefined;
    this.change = change;
    /** @type {Place} */
    this.size = [image.naturalHeight, image.naturalWidth];
    /** @type {RawGrid | Cells} */
    this.grid = { size: /** @type {Place} */ (this.size.map((side) => findNearest(listDivisors(side), USUAL_PIXELS))) };
    const [height, width] = this.size;
    this.pattern = draw("pattern", { id: "lenses", patternUnits: "userSpaceOnUse" });
    const overlay = draw("svg", { viewBox: `0 0 ${width} ${height}` });
    overlay.append(this.pattern, draw("rect", { width: "100%", height: "100%", fill: "url(#lenses)" }));
    this.layer = make("div", [image, overlay], { class: "layer" });
    this.first = this.#makeHandle(TEXTS.moveGrid, (to) => this.#move(to));
    this.second = this.#makeHandle(TEXTS.turnGrid, (to) => this.#turn(to));
    this.frame = make("div", [this.layer, this.first, this.second], { class: "pictures", tabindex: "0", role: "group", "aria-label": TEXTS.grid });
    this.frame.style.setProperty("--ratio", String(width / height));
    this.slider = make("input", "", { type: "range", min: "0", step: "0.1", value: "0" });
    this.slider.max = String(Math.max(0, Math.log2(Math.max(...this.size) / 32)));
    this.status = make("p", "", { "aria-live": "polite" });
    this.help = make("span");
    this.view = make("img", "", { hidden: "" });
    const zoom = make("label", [make("span", PICTURE_TEXTS.zoom), this.slider]);
    element.replaceChildren(this.frame, this.view, make("div", [this.help, this.status, zoom], { class: "controls" }));
    element.classList.add("lens-grid");
    followGestures(this.frame, this.slider, () => this.#look())();
    new ResizeObserver(() => this.#look()).observe(this.frame);
  }

  /** @param {RawGrid | Cells} grid */
  draw(grid) {
    if (isRaw(this.grid) && isRaw(grid) && this.anchor && this.end) {
      this.anchor = findLens(grid, findCentre(this.grid, this.anchor)); // the same places, by the new grid's numbers
      this.end = findLens(grid, findCentre(this.grid, this.end));
    } else if (isRaw(this.grid) !== isRaw(grid)) this.anchor = undefined;
    this.grid = grid;
    this.#look();
  }

  /**
   * Shows the centre view as the grid maps it.
   * @param {HTMLImageElement} view
   */
  showView(view) {
    view.className = "view";
    this.view.replaceWith(view);
    this.view = view;
  }

  /** Pixels of the screen for each pixel of the picture. */
  get #scale() {
    return (this.frame.clientWidth / this.size[1]) * 2 ** Number(this.slider.value);
  }

  /** Returns the visible part of the picture. */
  #readWindow() {
    const frame = this.frame.getBoundingClientRect(), layer = this.layer.getBoundingClientRect(), scale = this.#scale;
    const top = (frame.top - layer.top) / scale, left = (frame.left - layer.left) / scale;
    return { top, left, bottom: top + frame.height / scale, right: left + frame.width / scale };
  }

  /** @param {Place} place */
  #isSeen([y, x]) {
    const { top, left, bottom, right } = this.#readWindow();
    return top < y && y < bottom && left < x && x < right;
  }

  /** Places the handles on visible lenses, unless one is being dragged, and draws. */
  #look() {
    if (this.frame.clientWidth === 0) return; // not shown
    this.image.style.imageRendering = this.#scale > 1 ? "pixelated" : "auto";
    if (!this.frame.querySelector("[data-held]")) {
      const { top, left, bottom, right } = this.#readWindow();
      const look = (/** @type {number} */ share) => /** @type {Place} */ ([top + share * (bottom - top), left + share * (right - left)]);
      if (isRaw(this.grid)) {
        this.anchor ??= findLens(this.grid, look(0.3));
        this.end = findLens(this.grid, look(0.7));
      } else {
        this.end = /** @type {Place} */ (look(0.6).map((place, axis) => Math.max(1, Math.round(place / sizeOf(this.grid)[axis]))));
      }
    }
    this.#draw();
  }

  #draw() {
    const { grid } = this, scale = this.#scale;
    const [high, wide] = sizeOf(grid);
    const step = 2 ** Math.max(0, Math.ceil(Math.log2(NEAREST / (scale * Math.min(high, wide)))));
    this.frame.style.setProperty("--line", String(1 / scale));
    const { shapes, ...attributes } = isRaw(grid) ? drawLenses(grid, step, Math.max(RADIUS * grid.pitch, 1.5 / scale)) : drawCells(grid, step);
    for (const [name, value] of Object.entries(attributes)) this.pattern.setAttribute(name, String(value));
    this.pattern.replaceChildren(...shapes);
    const lens = isRaw(grid) ? SENTENCES.rawGrid(grid.pitch, grid.rotation) : SENTENCES.grid(this.#count(grid).join("x"), grid.size.join("x"));
    this.status.textContent = step > 1 ? `${lens}. ${SENTENCES.everyLens(step)}` : lens;
    this.help.textContent = isRaw(grid) ? TEXTS.rawHelp : TEXTS.cellsHelp;
    this.first.hidden = !isRaw(grid) || !this.#isSeen(findCentre(grid, this.anchor ?? [0, 0]));
    this.second.setAttribute("aria-label", isRaw(grid) ? TEXTS.turnGrid : TEXTS.resizeGrid);
    if (isRaw(grid)) this.#placeHandle(this.first, findCentre(grid, this.anchor ?? [0, 0]));
    this.#placeHandle(this.second, this.#findEnd());
  }

  /**
   * Returns the place of the second handle.
   * @returns {Place}
   */
  #findEnd() {
    const { grid, end = [1, 1] } = this;
    return isRaw(grid) ? findCentre(grid, end) : [end[0] * grid.size[0], end[1] * grid.size[1]];
  }

  /**
   * Counts how many cells fit into the picture.
   * @param {Cells} cells
   */
  #count({ size }) {
    return this.size.map((side, axis) => Math.round(side / size[axis]));
  }

  /**
   * Moves all lenses.
   * @param {Place} to The new place of the first handle.
   */
  #move(to) {
    if (!isRaw(this.grid) || !this.anchor) return;
    const from = findCentre(this.grid, this.anchor);
    const { offset } = this.grid;
    this.#changeRaw({ ...this.grid, offset: [offset[0] + to[0] - from[0], offset[1] + to[1] - from[1]] });
  }

  /**
   * Changes pitch and rotation about the first handle, or the size of elemental images.
   * @param {Place} to The new place of the second handle.
   */
  #turn(to) {
    const { grid, end = [1, 1] } = this;
    if (!isRaw(grid)) {
      const size = /** @type {Place} */ (this.size.map((side, axis) => findNearest(listDivisors(side), to[axis] / end[axis])));
      this.grid = { ...grid, size };
      this.#draw();
      return this.change(grid.isMosaic ? { arrangement: "mosaic", pixels: this.#count({ size }).join("x") } : { pixels: size.join("x") });
    }
    const pivot = findCentre(grid, this.anchor ?? [0, 0]), from = findCentre(grid, end);
    const before = [from[0] - pivot[0], from[1] - pivot[1]], after = [to[0] - pivot[0], to[1] - pivot[1]];
    const times = Math.hypot(...after) / Math.hypot(...before);
    const degrees = ((Math.atan2(after[0], after[1]) - Math.atan2(before[0], before[1])) * 180) / Math.PI;
    const { pitch, rotation, offset } = grid;
    if (!(5 <= pitch * times && pitch * times <= 200) || Math.abs(rotation + degrees) > 45) return;
    const turned = { ...grid, pitch: pitch * times, rotation: rotation + degrees };
    const moved = findCentre(turned, this.anchor ?? [0, 0]);
    this.#changeRaw({ ...turned, offset: [offset[0] + pivot[0] - moved[0], offset[1] + pivot[1] - moved[1]] });
  }

  /** @param {RawGrid} grid */
  #changeRaw(grid) {
    this.grid = grid;
    this.#draw();
    const [y, x] = findCentre(grid, this.anchor ?? [0, 0]).map((place) => Math.max(0, place - HALF).toFixed(2));
    this.change({
      lens_pitch: grid.pitch.toFixed(4), lens_offset: `${y},${x}`, lens_rotation: grid.rotation.toFixed(4), lens_grid: grid.shape,
    });
  }

  /**
   * @param {string} label
   * @param {(to: Place) => void} drag
   */
  #makeHandle(label, drag) {
    const handle = make("button", "", { type: "button", class: "handle", "aria-label": label });
    const locate = () => /** @type {Place} */ (handle === this.first && isRaw(this.grid) ? findCentre(this.grid, this.anchor ?? [0, 0]) : this.#findEnd());
    handle.addEventListener("keydown", (event) => {
      const way = KEYS[event.key];
      if (!way || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      event.stopPropagation();
      handle.dataset.held = "";
      drag(isRaw(this.grid) ? /** @type {Place} */ (locate().map((place, axis) => place + way[axis] * STEP * (event.shiftKey ? 10 : 1))) : this.#step(way));
      delete handle.dataset.held;
    });
    handle.addEventListener("pointerdown", (event) => {
      event.stopPropagation(); // the picture must not move
      handle.setPointerCapture(event.pointerId);
      handle.dataset.held = "";
      const begin = locate(), { clientX, clientY } = event;
      handle.onpointermove = (moved) =>
        drag([begin[0] + (moved.clientY - clientY) / this.#scale, begin[1] + (moved.clientX - clientX) / this.#scale]);
      handle.onlostpointercapture = () => {
        handle.onpointermove = null;
        delete handle.dataset.held;
      };
    });
    return handle;
  }

  /**
   * Returns the place of the corner for the next size that divides the picture.
   * @param {[number, number]} way
   * @returns {Place}
   */
  #step(way) {
    const { end = [1, 1] } = this;
    return /** @type {Place} */ (
      this.size.map((side, axis) => {
        const divisors = listDivisors(side), place = divisors.indexOf(findNearest(divisors, sizeOf(this.grid)[axis])) + way[axis];
        return divisors[Math.min(Math.max(place, 0), divisors.length - 1)] * end[axis];
      })
    );
  }

  /**
   * @param {HTMLElement} handle
   * @param {Place} place
   */
  #placeHandle(handle, [y, x]) {
    handle.style.setProperty("--top", `${(100 * y) / this.size[0]}%`);
    handle.style.setProperty("--left", `${(100 * x) / this.size[1]}%`);
  }
}

/**
 * Draws the pattern that is repeated over a raw picture.
 * @param {RawGrid} grid
 * @param {number} step One lens in `step` is drawn in each row and column: a power of 2.
 * @param {number} radius
 */
function drawLenses(grid, step, radius) {
  const { rowStep, shift, isTransposed } = readShape(grid);
  const isShifted = shift > 0 && step === 1;
  const width = grid.pitch * step, row = width * rowStep;
  const centres = [[width / 2, row / 2], ...(isShifted ? [[0, 1.5 * row], [width, 1.5 * row]] : [])];
  const exchange = isTransposed ? "matrix(0 1 1 0 0 0) " : "";
  return {
    width,
    height: isShifted ? 2 * row : row,
    patternTransform: `translate(${grid.offset[1] + HALF} ${grid.offset[0] + HALF}) rotate(${grid.rotation}) ${exchange}translate(${-width / 2} ${-row / 2})`,
    shapes: centres.map(([cx, cy]) => draw("circle", { cx, cy, r: radius })),
  };
}

/**
 * Draws the pattern that is repeated over elemental images.
 * @param {Cells} cells
 * @param {number} step One in `step` is drawn.
 */
function drawCells({ size }, step) {
  const [height, width] = size.map((side) => side * step);
  return { width, height, patternTransform: "", shapes: [draw("path", { d: `M0 0H${width}V${height}H0Z` })] };
}

/**
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 */
function draw(tag, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  return element;
}
