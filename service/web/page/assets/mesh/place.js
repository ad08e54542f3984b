// @ts-check
/** Turns a mesh by hand. It follows at once if three.js can read it, otherwise when the server has rendered it. */
import { find, make } from "../dom.js";
import { stop } from "../job/job.js";
import { TEXTS } from "../texts.js";

/** @typedef {import("../input/inputs.js").Input} Input */
/** @typedef {import("./preview.js").Preview} Preview */

const KEYS = /** @type {Record<string, [string, number]>} */ ({
  ArrowLeft: ["yaw", -5], ArrowRight: ["yaw", 5], ArrowUp: ["tilt", -5], ArrowDown: ["tilt", 5],
  "+": ["zoom", 0.1], "=": ["zoom", 0.1], "-": ["zoom", -0.1],
});
const FIELDS = ["yaw", "tilt", "roll", "zoom", "place", "depth_factor", "up", "background"];
/** Options that place a mesh differently from the preview. */
const OTHERS = ["fit", "camera", "time", "animation", "delta", "parallax", "pitch"];
const MOST_BYTES = 64e6; // of a file that is read in the browser

const panel = find("turn", HTMLElement);
const form = find("settings", HTMLFormElement);
/** @type {() => Record<string, string>} The settings of the page. */
let read = () => ({});
/** @type {Preview | undefined} */
let preview;
let canvas = make("canvas");
let opened = 0, isHeld = false, isDue = false;

/**
 * Shows a mesh as soon as the browser has read it, until the server has rendered it.
 * @param {Input} input
 */
export async function openMesh(input) {
  closeMesh();
  const number = opened;
  const files = input.parts ?? (input.file ? [{ name: input.name, file: input.file }] : []);
  if (files.length === 0 || files.some(({ file }) => file.size > MOST_BYTES)) return;
  /** @type {Preview | undefined} */
  let made;
  try {
    const { Preview } = await import("./preview.js");
    canvas = make("canvas", "", { hidden: "" });
    made = new Preview(canvas);
    await made.open(files);
  } catch {
    made?.close();
    return; // the server renders what three.js can't read
  }
  if (number !== opened) return made.close();
  preview = made;
  panel.replaceChildren(canvas);
  if (document.querySelector("#frame img") === null) draw();
}

/** Forgets the mesh. */
export function closeMesh() {
  opened += 1;
  preview?.close();
  preview = undefined;
  panel.replaceChildren();
  panel.hidden = true;
}

/**
 * @param {boolean} isMesh Whether the input is a mesh.
 * @param {string} mode What is shown of it: a drag turns it unless that has another use.
 */
export function allowTurning(isMesh, mode) {
  const other = mode === "around" ? TEXTS.aroundHelp : mode === "compare" ? TEXTS.compareHelp : undefined;
  panel.hidden = !isMesh || other !== undefined;
  find("turn-help", HTMLElement).textContent = other ?? TEXTS.turnHelp;
}

/** Whether the mesh is being dragged: pictures made meanwhile are previews. */
export function isTurning() {
  return isHeld;
}

/** Shows the server's picture in place of the preview, even if that is still to be drawn, unless the mesh is being turned. */
export function hidePreview() {
  canvas.hidden = !isHeld;
  isDue &&= isHeld;
}

/** Draws the mesh as the settings place it, before the next frame. */
function draw() {
  const settings = read();
  if (!preview || isDue || OTHERS.some((name) => name in settings)) return;
  isDue = true;
  requestAnimationFrame(() => {
    if (!isDue) return;
    isDue = false;
    const { lenses = "", pixels = "", up = "y", rotate = "0,0,0", zoom = "1", place = "-1", depth_factor = "1", background = "000000" } = read();
    const [rows, cols] = readPair(lenses, 100), [v, u] = readPair(pixels, 15);
    const factors = { zoom: Number(zoom), place: Number(place), depthFactor: Number(depth_factor) };
    preview?.fill(background);
    preview?.draw({ rows, cols, v, u, up, rotate: rotate.split(",").map(Number), ...factors });
    canvas.hidden = false;
  });
}

/**
 * @param {string} text A pair such as `50x60`.
 * @param {number} usual The value of both numbers if the text is not a pair.
 */
function readPair(text, usual) {
  const [, first = usual, second = usual] = /^([1-9]\d{0,5})\s*x\s*([1-9]\d{0,5})$/.exec(text) ?? [];
  return [Number(first), Number(second)];
}

/**
 * Changes a setting; the slider keeps it in range.
 * @param {string} name
 * @param {number} change
 */
function change(name, change) {
  const field = /** @type {HTMLInputElement} */ (form.elements.namedItem(name));
  const value = Number(field.value) + change;
  field.value = String(name === "yaw" ? ((value + 540) % 360) - 180 : value);
  field.dispatchEvent(new Event("input", { bubbles: true }));
}

/** Lets the server render what the settings say. */
function settle() {
  form.dispatchEvent(new Event("change", { bubbles: true }));
}

/**
 * Starts listening to events.
 * @param {() => Record<string, string>} readSettings
 */
export function watchPlace(readSettings) {
  read = readSettings;
  form.addEventListener("input", (event) => {
    if (!panel.hidden && event.target instanceof Element && FIELDS.includes(event.target.getAttribute("name") ?? "")) draw();
  });
  panel.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS) || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    stop();
    change(...KEYS[event.key]);
    settle();
  });
  panel.addEventListener("pointerdown", (event) => {
    isHeld = event.isPrimary && event.button === 0;
    if (!isHeld) return;
    panel.setPointerCapture(event.pointerId);
    let { clientX: x, clientY: y } = event;
    const end = new AbortController();
    const move = (/** @type {PointerEvent} */ { clientX, clientY }) => {
      const degrees = 180 / panel.clientWidth; // from side to side is half a turn
      const yaw = Math.trunc((clientX - x) * degrees), tilt = Math.trunc((clientY - y) * degrees);
      if (!yaw && !tilt) return;
      stop();
      change("yaw", yaw);
      change("tilt", tilt);
      x += yaw / degrees;
      y += tilt / degrees;
      settle();
    };
    const release = () => {
      end.abort();
      isHeld = false;
      settle();
    };
    panel.addEventListener("pointermove", move, { signal: end.signal });
    for (const name of ["pointerup", "pointercancel"]) panel.addEventListener(name, release, { signal: end.signal });
  });
}
