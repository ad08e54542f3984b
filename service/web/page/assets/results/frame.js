// @ts-check
/** The frame of the page: it shows one thing at a time, and makes it. */
import { decodeImage, find, make } from "../dom.js";
import { describe, makeForm, nameInput, nameStem, readImage } from "../input/inputs.js";
import { readGrid } from "../input/lenses.js";
import { askDisparity, keepRange } from "../input/ranges.js";
import { changeLenses, LENSES, listModels } from "../input/settings.js";
import { Job } from "../job/client.js";
import { clearNotes, perform, run, showReport } from "../job/job.js";
import { keepJob } from "../job/recent.js";
import { hidePreview, isTurning } from "../mesh/place.js";
import { SENTENCES, TEXTS } from "../texts.js";
import { showComparison } from "./compare.js";
import { findGroup, nameResult } from "./export.js";
import { LensGrid } from "./grid.js";
import { showLightField } from "./light_field.js";
import { addOverlays } from "./overlays.js";

/** @typedef {import("../input/inputs.js").Input} Input */
/** @typedef {Record<string, string>} Settings */

const frame = find("frame", HTMLElement);
/** @typedef {{picture: Blob, status: import("../job/client.js").Status}} Made A picture, and the job that made it. */
/** @type {WeakMap<Input, Map<string, Made>>} The pictures of an input, by the fields that made them. */
const pictures = new WeakMap();
/** @type {LensGrid | undefined} The lens grid that is shown. */
let lensGrid;
/** Closes the content of the frame. */
let closeShown = () => {};

/**
 * Shows an element in the frame, in place of the previous one.
 * @param {HTMLElement} element
 * @param {string} caption
 * @param {() => void} close Called when something else takes its place.
 */
export function fill(element, caption = "", close = () => {}) {
  closeShown();
  closeShown = close;
  frame.replaceChildren(element);
  find("caption", HTMLElement).textContent = caption;
}

/**
 * Makes and shows a picture of an input, as mapped first.
 * @param {Input} input
 * @param {Settings} settings
 * @param {string} mode
 * @param {AbortSignal} signal
 * @returns {Promise<string | void>} What the user has to do next.
 */
export async function makeShown(input, settings, mode, signal) {
  clearNotes();
  const isUnknown = input.kind === "picture" && !LENSES.some((name) => settings[name]);
  if (mode === "grid" || isUnknown) return showGrid(input, settings, isUnknown, signal);
  const isMapped = mode === "mapped" || (mode === "upscaled" && settings.model === "none");
  const isKept = isMapped && !isMesh(input); // for a mesh it is a preview
  await showPicture(await makeMapped(input, settings, signal, isKept), TEXTS.mapped, signal);
  if (mode === "upscaled" && !isMapped) {
    await showPicture(await makePicture(input, settings, TEXTS.upscaled, signal, true), TEXTS.upscaled, signal);
  }
  if (mode === "compare") await showCompared(input, settings, signal);
  if (mode === "around") await showAround(input, settings, signal);
}

/** @param {Input} input */
function isMesh({ kind }) {
  return kind === "mesh" || kind === "scene";
}

/**
 * Shows the picture with its lens grid, and the view that this grid maps.
 * @param {Input} input
 * @param {Settings} settings
 * @param {boolean} isUnknown Whether the lenses are still to be given.
 * @param {AbortSignal} signal
 * @returns {Promise<string | void>} What the user has to do next.
 */
async function showGrid(input, settings, isUnknown, signal) {
  if (!lensGrid?.element.isConnected) {
    const { crop = "" } = settings;
    const read = () => makePicture(input, { crop, pixels: "1x1", arrangement: "eia", model: "none" }, TEXTS.reading, signal); // each pixel a lens
    const image = await readImage(crop ? undefined : input.file, read);
    signal.throwIfAborted();
    image.alt = SENTENCES.job(TEXTS.grid, input.name);
    const holder = make("div");
    fill(holder);
    lensGrid = new LensGrid(holder, image, changeLenses);
  }
  const options = Object.fromEntries(Object.entries(settings).filter(([name]) => LENSES.includes(name)));
  const grid = readGrid(options, lensGrid.size) ?? (isUnknown ? lensGrid.grid : await findGrid(input, options, signal));
  if (grid) lensGrid.draw(grid);
  if (!isUnknown) {
    const view = await decodeImage(await makeMapped(input, settings, signal), { alt: TEXTS.mapped });
    signal.throwIfAborted();
    return lensGrid.showView(view);
  }
  /** @type {HTMLInputElement | null} */ (document.querySelector("[name=lenses]"))?.focus();
  return TEXTS.needsLenses;
}

/**
 * Finds the lens grid of a raw picture, as far as the options don't give it.
 * @param {Input} input
 * @param {Record<string, string>} options
 * @param {AbortSignal} signal
 */
async function findGrid(input, options, signal) {
  return (await describe(input, signal, options)).candidates.find((each) => each.lens_grid)?.lens_grid;
}

/**
 * Makes the centre view. While a mesh is being turned, the view is neither listed nor kept.
 * @param {Input} input
 * @param {Record<string, string>} fields
 * @param {string} what
 * @param {AbortSignal} signal
 * @param {boolean} [isKept] Whether the job is listed.
 * @returns {Promise<Blob>}
 */
async function makePicture(input, fields, what, signal, isKept = false) {
  const made = pictures.get(input) ?? new Map();
  pictures.set(input, made);
  const key = JSON.stringify(fields);
  const found = made.get(key);
  if (found) {
    showReport(found.status);
    return found.picture;
  }
  const isPreview = isTurning();
  const { job, response } = await makeFile(input, "reconstructions", { ...fields, format: "png" }, what, signal, isKept && !isPreview);
  const picture = await response.blob();
  signal.throwIfAborted();
  if (!isPreview) made.set(key, { picture, status: job.status });
  return picture;
}

/**
 * Makes the centre view as mapped.
 * @param {Input} input
 * @param {Settings} settings
 * @param {AbortSignal} signal
 * @param {boolean} [isKept] Whether the job is listed.
 */
function makeMapped(input, settings, signal, isKept) {
  return makePicture(input, { ...settings, model: "none", scale: "" }, TEXTS.mapped, signal, isKept);
}

/**
 * Shows the centre view as made in several ways, and for a mesh the truth.
 * @param {Input} input
 * @param {Settings} settings
 * @param {AbortSignal} signal
 */
async function showCompared(input, settings, signal) {
  const models = (await listModels(Number(settings.scale) || 2)).filter((name) => name !== "bicubic");
  const named = { [TEXTS.mapped]: "none", [TEXTS.bicubic]: "bicubic", [TEXTS.upscaled]: settings.model };
  const compared = [...Object.entries(named), ...models.map((name) => [name, name])].map(([name, model]) => {
    const fields = { ...settings, model, scale: model === "none" ? "" : settings.scale };
    return { name, make: (/** @type {AbortSignal} */ ended) => makePicture(input, fields, name, ended) };
  });
  const hasTruth = isMesh(input);
  const makeTruth = (/** @type {AbortSignal} */ ended) => makePicture(input, { ...settings, model: "", strategy: "direct" }, TEXTS.truth, ended);
  if (hasTruth) compared.push({ name: TEXTS.truth, make: makeTruth });
  const holder = make("div");
  await showComparison(holder, compared, [0, 2], hasTruth ? await makeTruth(signal) : undefined, signal, perform);
  signal.throwIfAborted();
  fill(holder);
}

/**
 * Shows all views, as mapped until they are upscaled.
 * @param {Input} input
 * @param {Settings} settings
 * @param {AbortSignal} signal
 */
async function showAround(input, settings, signal) {
  const holder = make("div");
  const all = { ...settings, views: "all", format: "tiles" };
  const isMapped = settings.model === "none";
  const mapped = await makeFile(input, "reconstructions", { ...all, model: "none", scale: "" }, isMapped ? TEXTS.around : TEXTS.mapped, signal, isMapped);
  let stage = await showViews(holder, mapped.response, signal, isMapped ? 1 : Number(settings.scale) || 2);
  try {
    if (!isMapped) stage = await showViews(holder, (await makeFile(input, "reconstructions", all, TEXTS.around, signal)).response, signal);
  } finally {
    addOverlays(stage, () =>
      perform(async (ended) => {
        const { job, response } = await makeFile(input, "disparities", askDisparity(settings), TEXTS.depth, ended);
        keepRange(input, settings, job.status.report);
        return response.blob();
      }),
    );
  }
}

/**
 * Shows the views of a response. The frame keeps its content until the first of them are loaded.
 * @param {HTMLElement} holder
 * @param {Response} response
 * @param {AbortSignal} signal
 * @param {number} [scale] As in `showLightField`.
 */
export function showViews(holder, response, signal, scale) {
  return showLightField(holder, response, { scale, signal, place: (stage) => fill(holder, "", () => stage.close()) });
}

/**
 * @param {Blob} picture
 * @param {string} what
 * @param {AbortSignal} signal
 */
export async function showPicture(picture, what, signal) {
  const image = await decodeImage(picture, { alt: SENTENCES.job(what, document.title) });
  signal.throwIfAborted();
  fill(image, SENTENCES.size(what, image.naturalHeight, image.naturalWidth));
  hidePreview();
}

/**
 * Runs a job on an input.
 * @param {Input} input
 * @param {string} plural
 * @param {Record<string, string | Blob>} fields
 * @param {string} what The kind of result.
 * @param {AbortSignal} signal
 * @param {boolean} [isKept] Whether the job is listed.
 */
export async function makeFile(input, plural, fields, what, signal, isKept = true) {
  if (!input.scene && !input.file) throw new Error(SENTENCES.again(input.name));
  const start = async (/** @type {(share: number) => void} */ report) => {
    const job = await Job.post(plural, makeForm(input, fields), signal, report);
    const named = { name: nameInput(input), what, stem: nameStem(input), end: nameResult(plural, fields), group: findGroup(plural, fields) };
    const made = { ...named, url: job.url, hash: location.hash, state: job.status.state };
    if (isKept) keepJob(made, fields);
    return job;
  };
  const made = await run(start, what, signal);
  showReport(made.job.status);
  return made;
}
