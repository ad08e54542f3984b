// @ts-check
/** The page: what is opened is shown as mapped at once, then as the user chose. */
import { Job, request, setKey } from "./client.js";
import { showComparison } from "./compare.js";
import { find, make } from "./dom.js";
import { offerFormats, saveResponse, watchExport } from "./export.js";
import { describe, joinFiles, listChosen, listDropped, makeForm } from "./inputs.js";
import { begin, clear, run, say, showProblem, stop } from "./job.js";
import { PLACE, showLightField } from "./light_field.js";
import { addOverlays } from "./overlays.js";
import { keepJob, showRecent } from "./recent.js";
import { fitSettings, offerGrids, offerModels, readSettings, watchSettings } from "./settings.js";
import { readState, writeState } from "./state.js";
import { KINDS, SENTENCES, TEXTS, writeTexts } from "./texts.js";

/** @import { Input } from "./inputs.js" */
/** @import { Entry } from "./recent.js" */

const GRID = ["lenses", "pixels", "lens_pitch"]; // options that give the lens grid of a picture
const SETTLE_MILLISECONDS = 250; // after a change of a setting, as a key may be pressed again
const frame = find("frame", HTMLElement);
const modes = /** @type {HTMLInputElement[]} */ ([...document.querySelectorAll("[name=show]")]);
/** What is open. @type {Input | null} */
let input = null;
let kind = "";
/** Pictures of what is open, by what they were made with. @type {Map<string, Blob>} */
const pictures = new Map();
/** The light field that is shown. @type {{close: () => void} | undefined} */
let stage;

/**
 * Opens an input: says what it is, and shows it.
 * @param {Promise<Input> | Input} chosen
 * @param {Record<string, string>} settings Of the address.
 */
async function open(chosen, settings) {
  clear();
  pictures.clear();
  find("caption", HTMLElement).textContent = "";
  frame.replaceChildren(make("p", TEXTS.waiting));
  showPart("work");
  say(TEXTS.packing);
  try {
    input = await chosen;
    writeName(input, TEXTS.reading);
    const found = await describe(input, begin(TEXTS.reading));
    kind = found.kind;
    writeName(input, KINDS[kind] ?? "");
    fitSettings(kind);
    offerGrids(found.candidates, settings);
    offerFormats(kind);
  } catch (error) {
    return showProblem(error, input?.name ?? "", () => void open(chosen, settings));
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

/** Shows one of the page's parts. @param {"start" | "work"} part */
function showPart(part) {
  for (const name of ["start", "work"]) find(name, HTMLElement).hidden = name !== part;
  find("close", HTMLElement).hidden = part === "start";
}

/** Makes and shows the picture that is chosen, as mapped first. */
async function show() {
  stop();
  stage?.close();
  if (!input) return;
  const settings = readSettings();
  const mode = modes.find((field) => field.checked)?.value ?? "upscaled";
  keepState({ ...settings, show: mode });
  if (kind === "picture" && !GRID.some((name) => name in settings)) return askForLenses();
  try {
    await showBlob(await makePicture({ ...settings, model: "none", scale: "" }, TEXTS.mapped, mode === "mapped"), TEXTS.mapped);
    if (mode === "upscaled") await showBlob(await makePicture(settings, TEXTS.upscaled, true), TEXTS.upscaled);
    if (mode === "compare") await showCompared(settings);
    if (mode === "around") await showAround(settings);
  } catch (error) {
    showProblem(error, input.name, () => void show());
  }
}

/** Says that an elemental image array needs its lens grid. */
function askForLenses() {
  say(TEXTS.needsLenses);
  frame.replaceChildren(make("p", TEXTS.waiting));
  /** @type {HTMLInputElement | null} */ (document.querySelector("[name=lenses]"))?.focus();
}

/** Puts the input and its settings into the address. @param {Record<string, string>} settings */
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

/** Shows the centre view as it is made in several ways, and the truth of a mesh. @param {Record<string, string>} settings */
async function showCompared(settings) {
  const compared = [];
  for (const [name, model] of Object.entries({ [TEXTS.mapped]: "none", [TEXTS.bicubic]: "bicubic", [TEXTS.upscaled]: settings.model })) {
    compared.push({ name, picture: await makePicture({ ...settings, model, scale: model === "none" ? "" : settings.scale }, name) });
  }
  const hasTruth = kind === "mesh" || kind === "scene";
  const truth = hasTruth ? await makePicture({ ...settings, model: "", strategy: "direct" }, TEXTS.truth) : undefined;
  await showComparison(makeHolder(TEXTS.compare), compared, truth);
}

/** An element in place of what is shown. @param {string} what It shows. */
function makeHolder(what) {
  const holder = make("div");
  frame.replaceChildren(holder);
  find("caption", HTMLElement).textContent = what;
  return holder;
}

/** Shows all views. @param {Record<string, string>} settings */
async function showAround(settings) {
  const response = await makeFile("reconstructions", { ...settings, views: "all", format: "tiles" }, TEXTS.around);
  const shown = (stage = await showLightField(makeHolder(TEXTS.around), response));
  addOverlays(shown, async () => {
    const { scale, model, ...reading } = settings;
    return (await makeFile("disparities", { ...reading, format: "viridis" }, TEXTS.depth)).blob();
  });
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

/** Opens a job of the list: a shipped scene with its settings, else its result. @param {Entry} entry */
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
    await showBlob(await response.blob(), entry.what);
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

/** Opens files that were chosen, with the settings of the address where it is about a file. @param {{name: string, file: File}[]} files */
function openFiles(files) {
  if (files.length === 0) return;
  const { scene, file, show: _, ...settings } = readState();
  void open(joinFiles(files), file ? settings : {});
}

writeTexts();
let settling = 0;
watchSettings(() => {
  clearTimeout(settling);
  settling = setTimeout(show, SETTLE_MILLISECONDS);
});
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
document.addEventListener("dragover", (event) => event.preventDefault());
document.addEventListener("drop", async (event) => {
  event.preventDefault();
  if (event.dataTransfer) openFiles(await listDropped(event.dataTransfer));
});
find("close", HTMLButtonElement).addEventListener("click", () => {
  clear();
  input = null;
  history.replaceState(null, "", location.pathname);
  openAddress();
});
find("key-form", HTMLFormElement).addEventListener("submit", (event) => {
  event.preventDefault();
  setKey(find("key", HTMLInputElement).value);
  find("retry", HTMLButtonElement).click();
});
addEventListener("hashchange", openAddress);
showRecent(reopen);
openAddress();
offerModels().catch(() => {}); // without the list, the network is selected automatically
