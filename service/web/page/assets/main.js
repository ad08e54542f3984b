// @ts-check
/** The page. An input is first shown as mapped, then as the user chose. */
import { find, make } from "./dom.js";
import { describe, isAnimated, joinFiles, listChosen, listDropped, nameInput, nameStem } from "./input/inputs.js";
import { findRange } from "./input/ranges.js";
import { fitSettings, LENSES, mergeSettings, offerGrids, offerModels, readSettings, watchSettings } from "./input/settings.js";
import { isEnded, Job, Problem, request, setKey } from "./job/client.js";
import { clear, clearNotes, EXPORT, perform, run, showProblem, showReport, showStatus } from "./job/job.js";
import { forgetJob, isUnfinished, watchRecent } from "./job/recent.js";
import { allowTurning, closeMesh, openMesh, watchPlace } from "./mesh/place.js";
import { fillFocus, nameResult, offerFormats, saveResponse, watchExport } from "./results/export.js";
import { fill, makeFile, makeShown, showPicture, showViews } from "./results/frame.js";
import { PLACE } from "./results/light_field.js";
import { readState, replaceState } from "./state.js";
import { KINDS, SENTENCES, TEXTS, writeTexts } from "./texts.js";

/** @typedef {import("./input/inputs.js").Input} Input */
/** @typedef {import("./job/recent.js").Entry} Entry */

const SETTLE_MILLISECONDS = 250; // after a change of a setting, as a key may be pressed again
const MESH_PIXELS = "7x7"; // for meshes, as for the examples: the server's default of 15x15 takes four times as long
const NEEDS_GRID = /give pixels ROWSxCOLUMNS/; // in an error of the server
/** Settings on which the viewpoint or the focus depends. */
const PLACED = [...LENSES, "rotate", "zoom", "place", "depth_factor", "up", "time", "order", "transpose", "flip", "depth_sense"];
const modes = /** @type {HTMLInputElement[]} */ ([...document.querySelectorAll("[name=show]")]);
const save = find("save", HTMLButtonElement); // for a recent job whose file is not open, so that nothing else can be exported
/** @type {Input | null} The open input. */
let input = null;
/** @type {Record<string, string> | null} The settings with which the open input was last shown. */
let made = null;

/** Ends all work and closes the open input. */
function leave() {
  clear();
  closeMesh();
  save.hidden = true;
  fill(make("p", TEXTS.waiting));
  input = made = null;
  fitSettings([]);
  writeName("", "");
}

/**
 * Does work in place of the previous work, and shows errors.
 * @param {(signal: AbortSignal) => Promise<string | void>} action Returns what the user has to do next, if anything.
 * @param {string} [name] The name to show if nothing is open.
 * @param {import("./job/job.js").Place} [place] Where it is reported.
 * @returns {Promise<void>}
 */
async function attempt(action, name = "", place) {
  const heading = find("name", HTMLElement);
  try {
    const message = await perform(action, place);
    if (message) showStatus(message);
  } catch (error) {
    if (!isEnded(error)) showPart("work"); // where problems are shown
    heading.textContent ||= name;
    showProblem(error, heading.textContent ?? "", () => void attempt(action, name, place));
  }
}

/**
 * Opens an input, says what it is, and shows it.
 * @param {Promise<Input> | Input} chosen
 */
function open(chosen) {
  leave();
  showPart("work");
  return attempt(async (signal) => {
    showStatus(TEXTS.packing);
    const given = await chosen;
    signal.throwIfAborted();
    writeName(nameInput(given), "");
    const settings = takeSettings(given);
    const { kind, candidates, light_field: views, error } = await describe(given, signal).catch(askGrid);
    writeName(nameInput(given), KINDS[kind] ?? "");
    const what = kind === "mesh" && (await isAnimated(given)) ? [kind, "animated"] : [kind];
    signal.throwIfAborted();
    fitSettings(what, views && `${views.rows}x${views.cols}`);
    if (kind === "mesh") void openMesh(given);
    offerGrids(candidates, kind === "mesh" ? { pixels: MESH_PIXELS, ...settings } : settings);
    offerFormats(what);
    input = { ...given, kind };
    if (error && !settings.pixels) throw error;
    return makeChosen(input, signal);
  });
}

/**
 * Describes views whose rows and columns the server can't find: the user gives them.
 * @param {unknown} error
 * @returns {import("./input/inputs.js").Description}
 */
function askGrid(error) {
  if (error instanceof Problem && NEEDS_GRID.test(error.detail)) return { kind: "views", candidates: [], notes: [], error };
  throw error;
}

/**
 * Returns the settings of the address if it names this input. Otherwise they don't apply, and the input replaces them in the address.
 * @param {Input} given
 */
function takeSettings({ name, scene: own }) {
  const { scene, file, show: mode, ...settings } = readState();
  if (own ? own === scene : name === file) return settings;
  replaceState({ file: name });
  chooseMode();
  return {};
}

/**
 * @param {string} name
 * @param {string} what The kind of input.
 */
function writeName(name, what) {
  find("name", HTMLElement).textContent = name;
  document.title = name || "ciir";
  find("kind", HTMLElement).textContent = what;
}

/**
 * Shows one of the page's parts.
 * @param {"start" | "work"} part
 */
function showPart(part) {
  const focused = document.activeElement;
  for (const name of ["start", "work"]) find(name, HTMLElement).hidden = name !== part;
  find("close", HTMLElement).hidden = part === "start";
  const isLost = focused !== document.body && focused?.getClientRects().length === 0;
  if (isLost) find(part === "start" ? "files" : "name", HTMLElement).focus();
}

/** Shows the open input as the user chose, unless it is still being read. */
async function show() {
  const opened = input;
  if (opened) await attempt((signal) => makeChosen(opened, signal));
}

/**
 * Makes and shows what the settings say, and puts them into the address.
 * @param {Input} opened
 * @param {AbortSignal} signal
 */
async function makeChosen(opened, signal) {
  const settings = readSettings();
  const mode = modes.find((field) => field.checked && !field.closest("[hidden]"))?.value ?? "upscaled";
  keepState({ ...settings, show: mode });
  made = settings;
  allowTurning(opened.kind === "mesh" || opened.kind === "scene", mode);
  const next = await makeShown(opened, settings, mode, signal);
  void fillFocus();
  return next;
}

/**
 * Puts the input and its settings into the address. The viewpoint is dropped if the lenses change, which changes the views, and
 * the focus if the lenses or the object's pose change, which changes disparities.
 * @param {Record<string, string>} settings
 */
function keepState(settings) {
  const changed = made ? PLACED.filter((name) => settings[name] !== made?.[name]) : [];
  const left = changed.some((name) => LENSES.includes(name)) ? PLACE : changed.length > 0 ? ["focus"] : [];
  const place = Object.entries(readState()).filter(([name]) => PLACE.includes(name) && !left.includes(name));
  replaceState({ scene: input?.scene ?? "", file: input?.scene ? "" : (input?.name ?? ""), ...settings, ...Object.fromEntries(place) });
}

/**
 * Opens a job of the list: a shipped scene with its settings, or otherwise the job's result, once it is done.
 * @param {Entry} entry
 */
function reopen(entry) {
  const fetchResult = async (/** @type {AbortSignal} */ signal) => {
    const start = async () => {
      const status = await (await request(entry.url, { signal })).json();
      if (status.state === "cancelled") throw new Problem(404);
      return new Job(entry.url, status);
    };
    try {
      const { job, response } = await run(start, entry.what, signal, false);
      showReport(job.status);
      return response;
    } catch (error) {
      if (error instanceof Problem && [404, 410].includes(error.status)) forgetJob(entry.url);
      throw error;
    }
  };
  const download = (/** @type {import("./job/job.js").Place | undefined} */ place) =>
    void attempt(async (signal) => saveResponse(await fetchResult(signal), entry.stem ?? entry.name, entry.end ?? "", entry.name), entry.name, place);
  const isExport = entry.what === TEXTS.export;
  if (!isExport && new URLSearchParams(entry.hash.slice(1)).has("scene")) return goTo(entry.hash);
  if (isExport && !isUnfinished(entry)) return download(EXPORT);
  if (!input || nameInput(input) !== entry.name) {
    leave();
    if (isExport) fill(make("p", SENTENCES.job(entry.what, entry.name)));
    input = { name: entry.name };
    writeName(entry.name, "");
  }
  showPart("work");
  if (isExport) return download(input.kind ? EXPORT : undefined); // the form for exports is hidden without a file
  void attempt(async (signal) => {
    clearNotes();
    const response = await fetchResult(signal);
    history.replaceState(null, "", entry.hash);
    if (entry.what === TEXTS.around) await showViews(make("div"), response, signal);
    else await showPicture(await response.blob(), entry.what, signal);
    save.onclick = () => download(EXPORT);
    save.hidden = false;
  });
}

/**
 * Opens an address, so that Back leads to the previous one.
 * @param {string} address
 */
function goTo(address) {
  history.pushState(null, "", address);
  openAddress();
}

/** Opens the input that the address names. */
function openAddress() {
  const { scene, file, show: mode } = readState();
  chooseMode(mode);
  if (scene) return void open({ name: scene, scene });
  leave();
  showPart("start");
  find("again", HTMLElement).textContent = file ? SENTENCES.again(file) : "";
}

/** @param {string} mode */
function chooseMode(mode = "upscaled") {
  for (const field of modes) field.checked = field.value === mode;
}

/**
 * Opens files that were chosen, so that Back leads to the previous input.
 * @param {Promise<{name: string, file: File}[]>} files
 */
function openFiles(files) {
  history.pushState(null, "", location.href);
  void open(files.then(joinFiles));
}

writeTexts();
offerModels();
watchPlace(readSettings);
let settling = 0;
/** Shows what the settings say, once they no longer change. */
function settle() {
  clearTimeout(settling);
  settling = setTimeout(show, SETTLE_MILLISECONDS);
}
watchSettings(settle);
watchExport(() => (input ? findRange(input, readSettings()) : undefined), (plural, fields) => {
  const opened = input;
  if (!opened) return;
  void attempt(async (signal) => {
    const made = makeFile(opened, plural, mergeSettings(fields), TEXTS.export, signal);
    find("job", HTMLElement).scrollIntoView({ block: "nearest" });
    await saveResponse((await made).response, nameStem(opened), nameResult(plural, fields), nameInput(opened));
  }, "", EXPORT);
});
for (const field of modes) field.addEventListener("change", () => void show());
for (const id of ["files", "folder"]) {
  const field = find(id, HTMLInputElement);
  field.addEventListener("change", () => {
    const files = listChosen(field);
    field.value = ""; // so that the same file can be chosen again
    if (files.length > 0) openFiles(Promise.resolve(files));
  });
}
/** @param {boolean} isOver Whether something is dragged over the page. */
const markDrag = (isOver) => document.body.classList.toggle("dragging", isOver);
document.addEventListener("dragover", (event) => {
  event.preventDefault();
  markDrag(true);
});
document.addEventListener("dragleave", (event) => markDrag(event.relatedTarget !== null));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  markDrag(false);
  if (event.dataTransfer?.types.includes("Files")) openFiles(listDropped(event.dataTransfer));
});
find("close", HTMLButtonElement).addEventListener("click", () => goTo(location.pathname));
find("key-form", HTMLFormElement).addEventListener("submit", (event) => {
  event.preventDefault();
  setKey(find("key", HTMLInputElement).value);
  offerModels();
  find("retry", HTMLButtonElement).click();
});
addEventListener("popstate", openAddress);
watchRecent(reopen);
openAddress();
