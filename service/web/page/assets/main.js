// @ts-check
/** The page: what is opened is shown as mapped at once, then as the user chose. */
import { Job, request, setKey } from "./client.js";
import { showComparison } from "./compare.js";
import { find, make } from "./dom.js";
import { offerFormats, saveResponse, watchExport } from "./export.js";
import { LensGrid } from "./grid.js";
import { describe, joinFiles, listChosen, listDropped, makeForm, readImage } from "./inputs.js";
import { begin, clear, run, say, showProblem, stop } from "./job.js";
import { readGrid } from "./lenses.js";
import { PLACE, showLightField } from "./light_field.js";
import { addOverlays } from "./overlays.js";
import { allowTurning, closeMesh, hidePreview, openMesh, watchPlace } from "./place.js";
import { keepJob, showRecent } from "./recent.js";
import { fitSettings, LENSES, listModels, offerGrids, offerModels, readSettings, watchSettings, writeLenses } from "./settings.js";
import { readState, writeState } from "./state.js";
import { KINDS, SENTENCES, TEXTS, writeTexts } from "./texts.js";

/** @typedef {import("./inputs.js").Input} Input */
/** @typedef {import("./recent.js").Entry} Entry */

const SETTLE_MILLISECONDS = 250; // after a change of a setting, as a key may be pressed again
const frame = find("frame", HTMLElement);
const modes = /** @type {HTMLInputElement[]} */ ([...document.querySelectorAll("[name=show]")]);
/** @type {Input | null} What is open. */
let input = null;
let kind = "";
/** @type {Map<string, Blob>} Pictures of what is open, by what they were made with. */
const pictures = new Map();
/** @type {LensGrid | undefined} The lens grid that is shown. */
let lensGrid;
/** @type {import("./viewer/page.js").Stage | undefined} The light field that is shown. */
let stage;

/**
 * Opens an input: says what it is, and shows it.
 * @param {Promise<Input> | Input} chosen
 * @param {Record<string, string>} settings Of the address.
 * @returns {Promise<void>}
 */
async function open(chosen, settings) {
  clear();
  closeMesh();
  pictures.clear();
  find("caption", HTMLElement).textContent = "";
  frame.replaceChildren(make("p", TEXTS.waiting));
  showPart("work");
  say(TEXTS.packing);
  input = null;
  fitSettings("");
  /** @type {Input | undefined} */
  let given;
  try {
    given = await chosen;
    writeName(given, TEXTS.reading);
    const found = await describe(given, begin(TEXTS.reading));
    kind = found.kind;
    writeName(given, KINDS[kind] ?? "");
    fitSettings(kind);
    if (kind === "mesh") void openMesh(given);
    offerGrids(found.candidates, settings);
    offerFormats(kind);
    input = given;
  } catch (error) {
    if (given) writeName(given, "");
    return showProblem(error, given?.name ?? "", () => void open(chosen, settings));
  }
  await show();
}

/** @param {Input} named */
function nameInput(named) {
  return named.scene ? (TEXTS[/** @type {"vase"} */ (named.scene)] ?? named.scene) : named.name;
}

/**
 * @param {Input} named
 * @param {string} what It is.
 */
function writeName(named, what) {
  find("name", HTMLElement).textContent = document.title = nameInput(named);
  find("kind", HTMLElement).textContent = what;
}

/**
 * Shows one of the page's parts.
 * @param {"start" | "work"} part
 */
function showPart(part) {
  for (const name of ["start", "work"]) find(name, HTMLElement).hidden = name !== part;
  find("close", HTMLElement).hidden = part === "start";
}

/** Makes and shows the picture that is chosen, as mapped first. */
async function show() {
  if (!input) return; // it is still being read
  stop();
  say("");
  stage?.close();
  const settings = readSettings();
  const mode = modes.find((field) => field.checked && !field.closest("[hidden]"))?.value ?? "upscaled";
  keepState({ ...settings, show: mode });
  allowTurning((kind === "mesh" || kind === "scene") && (mode === "mapped" || mode === "upscaled"));
  const isUnknown = kind === "picture" && !LENSES.some((name) => settings[name]);
  try {
    if (mode === "grid" || isUnknown) return await showGrid(settings, isUnknown);
    await showBlob(await makePicture({ ...settings, model: "none", scale: "" }, TEXTS.mapped, mode === "mapped"), TEXTS.mapped);
    if (mode === "upscaled") await showBlob(await makePicture(settings, TEXTS.upscaled, true), TEXTS.upscaled);
    if (mode === "compare") await showCompared(settings);
    if (mode === "around") await showAround(settings);
  } catch (error) {
    showProblem(error, input.name, () => void show());
  }
}

/**
 * Shows the picture with its lens grid, and the view that is mapped by it.
 * @param {Record<string, string>} settings
 * @param {boolean} isUnknown Whether the lenses are still to be given.
 */
async function showGrid(settings, isUnknown) {
  if (!input) return;
  if (!lensGrid?.element.isConnected) {
    const { crop = "" } = settings;
    const read = () => makePicture({ crop, pixels: "1x1", arrangement: "eia", model: "none" }, TEXTS.reading); // each pixel a lens
    const image = await readImage(crop ? undefined : input.file, read);
    image.alt = SENTENCES.job(TEXTS.grid, input.name);
    lensGrid = new LensGrid(makeHolder(), image, (options) => {
      writeLenses(options);
      settle();
    });
  }
  const options = Object.fromEntries(Object.entries(settings).filter(([name]) => LENSES.includes(name)));
  const grid = readGrid(options, lensGrid.size) ?? (isUnknown ? lensGrid.grid : await findGrid(options));
  if (grid) lensGrid.draw(grid);
  if (!isUnknown) return lensGrid.showView(await makePicture({ ...settings, model: "none", scale: "" }, TEXTS.mapped));
  say(TEXTS.needsLenses);
  /** @type {HTMLInputElement | null} */ (document.querySelector("[name=lenses]"))?.focus();
}

/**
 * The lens grid of a raw picture, where options leave some of it to be found.
 * @param {Record<string, string>} options
 */
async function findGrid(options) {
  return input && (await describe(input, begin(TEXTS.reading), options)).candidates.find((each) => each.lens_grid)?.lens_grid;
}

/**
 * Puts the input and its settings into the address.
 * @param {Record<string, string>} settings
 */
function keepState(settings) {
  const old = Object.keys(readState()).filter((name) => !PLACE.includes(name));
  const source = input?.scene ? { scene: input.scene, file: null } : { scene: null, file: input?.name ?? "" };
  writeState({ ...Object.fromEntries(old.map((name) => [name, null])), ...source, ...settings });
}

/**
 * Makes the centre view.
 * @param {Record<string, string>} fields
 * @param {string} what
 * @param {boolean} [isKept] Whether the job is listed.
 */
async function makePicture(fields, what, isKept = false) {
  const key = JSON.stringify(fields);
  const picture = pictures.get(key) ?? (await (await makeFile("reconstructions", { ...fields, format: "png" }, what, isKept)).blob());
  pictures.set(key, picture);
  return picture;
}

/**
 * Shows the centre view as it is made in several ways, and the truth of a mesh.
 * @param {Record<string, string>} settings
 */
async function showCompared(settings) {
  await offered;
  const models = listModels(Number(settings.scale) || 2).filter((name) => name !== "bicubic");
  const named = { [TEXTS.mapped]: "none", [TEXTS.bicubic]: "bicubic", [TEXTS.upscaled]: settings.model };
  const compared = [...Object.entries(named), ...models.map((name) => [name, name])].map(([name, model]) => {
    const fields = { ...settings, model, scale: model === "none" ? "" : settings.scale };
    return { name, make: () => makePicture(fields, name) };
  });
  const hasTruth = kind === "mesh" || kind === "scene";
  const makeTruth = () => makePicture({ ...settings, model: "", strategy: "direct" }, TEXTS.truth);
  if (hasTruth) compared.push({ name: TEXTS.truth, make: makeTruth });
  const truth = hasTruth ? await makeTruth() : undefined;
  await showComparison(makeHolder(), compared, [0, 2], truth);
}

/** An element in place of what is shown. */
function makeHolder() {
  const holder = make("div");
  frame.replaceChildren(holder);
  find("caption", HTMLElement).textContent = "";
  return holder;
}

/**
 * Shows all views: as mapped, until they are upscaled.
 * @param {Record<string, string>} settings
 */
async function showAround(settings) {
  const holder = makeHolder();
  const all = { ...settings, views: "all", format: "tiles" };
  const mapped = await makeFile("reconstructions", { ...all, model: "none", scale: "" }, TEXTS.mapped, false);
  const scale = settings.model === "none" ? 1 : Number(settings.scale) || 2;
  let shown = (stage = await showLightField(holder, mapped, scale));
  try {
    shown = stage = await showLightField(holder, await makeFile("reconstructions", all, TEXTS.around));
  } finally {
    addOverlays(shown, async () => {
      const { scale, model, ...reading } = settings;
      return (await makeFile("disparities", { ...reading, format: "viridis" }, TEXTS.depth)).blob();
    });
  }
}

/**
 * @param {Blob} picture
 * @param {string} what
 */
async function showBlob(picture, what) {
  const image = make("img", "", { alt: SENTENCES.job(what, input ? nameInput(input) : "") });
  image.src = URL.createObjectURL(picture);
  await image.decode();
  frame.replaceChildren(image);
  hidePreview();
  URL.revokeObjectURL(image.src);
  find("caption", HTMLElement).textContent = SENTENCES.size(what, image.naturalHeight, image.naturalWidth);
}

/**
 * Runs a job of what is open.
 * @param {string} plural
 * @param {Record<string, string | Blob>} fields
 * @param {string} what It makes.
 * @param {boolean} [isKept] Whether the job is listed.
 */
async function makeFile(plural, fields, what, isKept = true) {
  if (!input) throw new Error(TEXTS.waiting);
  if (!input.scene && !input.file) throw new Error(SENTENCES.again(input.name));
  const { job, response } = await run(plural, makeForm(input, fields), what);
  if (isKept) {
    keepJob({ name: nameInput(input), what, url: job.url, hash: location.hash });
    showRecent(reopen);
  }
  return response;
}

/**
 * Opens a job of the list: a shipped scene with its settings, else its result.
 * @param {Entry} entry
 */
async function reopen(entry) {
  clear();
  try {
    const job = new Job(entry.url, await (await request(entry.url)).json());
    const response = await job.follow(() => {}, new AbortController().signal);
    if (entry.what === TEXTS.export) return void saveResponse(response, entry.name);
    history.replaceState(null, "", entry.hash);
    if (readState().scene) return openAddress();
    if (input?.name !== entry.name) input = { name: entry.name };
    writeName(input, "");
    showPart("work");
    if (entry.what === TEXTS.around) stage = await showLightField(makeHolder(), response);
    else await showBlob(await response.blob(), entry.what);
  } catch (error) {
    showProblem(error, entry.name, () => void reopen(entry));
  }
}

/** Opens what the address names. */
function openAddress() {
  const { scene, file, show: mode, ...settings } = readState();
  for (const field of modes) field.checked = field.value === (mode ?? "upscaled");
  if (scene) return void open({ name: scene, scene }, settings);
  showPart("start");
  find("again", HTMLElement).textContent = file ? SENTENCES.again(file) : "";
}

/**
 * Opens files that were chosen, with the settings of the address where it is about a file.
 * @param {{name: string, file: File}[]} files
 */
function openFiles(files) {
  if (files.length === 0) return;
  const { scene, file, show: _, ...settings } = readState();
  void open(joinFiles(files), file ? settings : {});
}

writeTexts();
let offered = offerModels().catch(() => {}); // without the list, the network is selected automatically
watchPlace(readSettings);
let settling = 0;
/** Shows what the settings say, once they rest. */
function settle() {
  clearTimeout(settling);
  settling = setTimeout(show, SETTLE_MILLISECONDS);
}
watchSettings(settle);
watchExport(
  (plural, fields) => makeFile(plural, { ...readSettings(), ...fields }, TEXTS.export),
  (error) => showProblem(error, input?.name ?? "", () => find("export-form", HTMLFormElement).requestSubmit()),
  () => input?.name ?? "",
);
for (const field of modes) field.addEventListener("change", () => void show());
for (const id of ["files", "folder"]) {
  const field = find(id, HTMLInputElement);
  field.addEventListener("change", () => openFiles(listChosen(field)));
}
for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-scene]"))) {
  const scene = button.dataset.scene ?? "";
  button.addEventListener("click", () => {
    writeState(Object.fromEntries(Object.keys(readState()).map((name) => [name, null])));
    void open({ name: scene, scene }, {});
  });
}
/** @param {boolean} isOver Whether something is dragged over the page. */
const markDrag = (isOver) => document.body.classList.toggle("dragging", isOver);
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  markDrag(true);
});
document.addEventListener("dragleave", (event) => markDrag(event.relatedTarget !== null));
document.addEventListener("drop", async (event) => {
  event.preventDefault();
  markDrag(false);
  if (event.dataTransfer) openFiles(await listDropped(event.dataTransfer));
});
find("close", HTMLButtonElement).addEventListener("click", () => {
  clear();
  closeMesh();
  input = null;
  history.replaceState(null, "", location.pathname);
  openAddress();
});
find("key-form", HTMLFormElement).addEventListener("submit", (event) => {
  event.preventDefault();
  setKey(find("key", HTMLInputElement).value);
  offered = offerModels().catch(() => {});
  find("retry", HTMLButtonElement).click();
});
addEventListener("hashchange", openAddress);
showRecent(reopen);
openAddress();
