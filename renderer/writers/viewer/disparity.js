// @ts-check
/** Measures the disparity at a place of a light field, from small copies of the views around its centre. */
import { VIEWER_TEXTS } from "./texts.js";

/** @typedef {import("./viewer.js").LightField} LightField */

const SMALL = 96; // pixels along a side of the copies
const STEP = 0.25; // of their pixels, in which disparity is searched for
const CLEAR = 0.5; // of 255: by how much the best disparity must fit better than half of all
const AROUND = [[0, 1], [0, -1], [1, 0], [-1, 0], [0, 2], [2, 0]];

/** Measures disparity. Call `add` with the views that `needs` names; then `measure`. */
export class DisparityMeter {
  /** @param {LightField} lightField */
  constructor(lightField) {
    this.lightField = lightField;
    /** @type {Map<number, Float32Array>} Brightness of each small view. */
    this.small = new Map();
    const { rows, cols } = lightField;
    this.centre = [(rows - 1) >> 1, (cols - 1) >> 1];
  }

  /**
   * Whether a view is one of those that are compared.
   * @param {number} index
   */
  needs(index) {
    const { cols } = this.lightField;
    const away = [Math.floor(index / cols) - this.centre[0], (index % cols) - this.centre[1]];
    return [[0, 0], ...AROUND].some(([v, u]) => v === away[0] && u === away[1]);
  }

  /**
   * Keeps a small copy of a view.
   * @param {number} index
   * @param {CanvasImageSource} picture
   */
  add(index, picture) {
    const canvas = Object.assign(document.createElement("canvas"), { width: SMALL, height: SMALL });
    const context = canvas.getContext("2d", { willReadFrequently: true });
    if (!context) throw new Error(VIEWER_TEXTS.noCanvas);
    context.drawImage(picture, 0, 0, SMALL, SMALL);
    const { data } = context.getImageData(0, 0, SMALL, SMALL);
    const brightness = (/** @type {unknown} */ _, /** @type {number} */ i) => (data[4 * i] + 2 * data[4 * i + 1] + data[4 * i + 2]) / 4;
    this.small.set(index, Float32Array.from({ length: SMALL * SMALL }, brightness));
  }

  /**
   * The disparity at a place of the centre view, in pixels, or of the whole of it: the one at which the neighbouring views differ least.
   * @param {number} [x] 0 to 1 from the left.
   * @param {number} [y] 0 to 1 from the top.
   * @returns {number | null} null where nothing there tells disparities apart, or the views are not loaded.
   */
  measure(x, y) {
    const { rows, cols, width, height } = this.lightField;
    const [v, u] = this.centre;
    const centre = this.small.get(v * cols + u);
    /** @type {{picture: Float32Array, v: number, u: number}[]} */
    const others = [];
    for (const [dv, du] of AROUND) {
      const row = v + dv, col = u + du;
      const picture = row >= 0 && row < rows && col >= 0 && col < cols ? this.small.get(row * cols + col) : undefined;
      if (picture) others.push({ picture, v: dv, u: du });
    }
    if (!centre || others.length === 0) return null;
    const radius = x === undefined ? SMALL / 2 : 5;
    const left = Math.round((x ?? 0.5) * SMALL), top = Math.round((y ?? 0.5) * SMALL);
    const shifts = Array.from({ length: SMALL / 2 / STEP + 1 }, (_, i) => i * STEP - SMALL / 4);
    const errors = shifts.map((shift) => difference(centre, others, left, top, radius, [(shift * width) / height, shift]));
    const best = errors.indexOf(Math.min(...errors));
    const usual = [...errors].sort((a, b) => a - b)[errors.length >> 1];
    if (usual - errors[best] < CLEAR) return null;
    return ((shifts[best] + STEP * findVertex(errors[best - 1], errors[best], errors[best + 1])) * width) / SMALL;
  }
}

/**
 * Where the parabola through three neighbours is lowest: -0.5 to 0.5 from the middle one, 0 at an end of the range.
 * @param {number | undefined} before
 * @param {number} lowest
 * @param {number | undefined} after
 */
function findVertex(before, lowest, after) {
  if (before === undefined || after === undefined || before + after <= 2 * lowest) return 0;
  return (before - after) / (2 * (before + after - 2 * lowest));
}

/**
 * The mean difference between the centre view and the others, shifted by `shift` for each view, in a square.
 * @param {Float32Array} centre
 * @param {{picture: Float32Array, v: number, u: number}[]} others
 * @param {number} left
 * @param {number} top
 * @param {number} radius
 * @param {[number, number]} shift Down and across.
 */
function difference(centre, others, left, top, radius, shift) {
  let sum = 0, count = 0;
  for (let y = Math.max(0, top - radius); y < Math.min(SMALL, top + radius + 1); y++) {
    for (let x = Math.max(0, left - radius); x < Math.min(SMALL, left + radius + 1); x++) {
      for (const other of others) {
        const across = x - shift[1] * other.u, down = y - shift[0] * other.v;
        if (across < 0 || down < 0 || across > SMALL - 1 || down > SMALL - 1) continue;
        sum += Math.abs(centre[y * SMALL + x] - interpolate(other.picture, across, down));
        count++;
      }
    }
  }
  return count > 0 ? sum / count : Infinity;
}

/**
 * @param {Float32Array} picture
 * @param {number} x
 * @param {number} y
 */
function interpolate(picture, x, y) {
  const left = Math.min(Math.floor(x), SMALL - 2), top = Math.min(Math.floor(y), SMALL - 2);
  const at = top * SMALL + left, across = x - left, down = y - top;
  const upper = picture[at] * (1 - across) + picture[at + 1] * across;
  const lower = picture[at + SMALL] * (1 - across) + picture[at + SMALL + 1] * across;
  return upper * (1 - down) + lower * down;
}
