// @ts-check
/** The form of settings: options of the API by their names, except that three angles together are the option `rotate`. */
import { find, make } from "../dom.js";
import { request } from "../job/client.js";
import { MODELS, SENTENCES, TEXTS } from "../texts.js";

/** @typedef {import("./inputs.js").Candidate} Candidate */

/** Options that say where the lenses of a picture are. */
export const LENSES = ["lenses", "pixels", "lens_pitch", "lens_offset", "lens_rotation", "lens_grid", "arrangement"];
const ANGLES = ["yaw", "tilt", "roll"];
/** The names that the server accepts: the basic colours of CSS. */
const NAMED_COLOURS = /** @type {Record<string, string>} */ ({
  ...{ aqua: "0ff", black: "000", blue: "00f", fuchsia: "f0f", gray: "808080", green: "008000", lime: "0f0", maroon: "800000" },
  ...{ navy: "000080", olive: "808000", purple: "800080", red: "f00", silver: "c0c0c0", teal: "008080", white: "fff", yellow: "ff0" },
});
const form = find("settings", HTMLFormElement);
/** @type {Map<string, number[]>} Scales of the networks, and of interpolations. */
const scales = new Map([["auto", [2]]]);
/** @type {Record<string, string>} Options from the address or a found lens grid that have no field, or a value that their field can't have. */
let others = {};
/** Whether the place was given: pictures for displays have another default, so one that is given counts even if it is as usual. */
let isPlaced = false;
/** Done when the networks are listed. */
let offered = Promise.resolve();
const grids = find("grids", HTMLSelectElement);
/** @type {Candidate[]} Lens grids that a picture may have. */
let candidates = [];

/** Lists the fields that apply to the open input. */
function listFields() {
  const all = /** @type {NodeListOf<HTMLInputElement | HTMLSelectElement>} */ (form.querySelectorAll("[name]"));
  return [...all].filter((field) => field.closest("[hidden]") === null);
}

/** @type {{field: EventTarget | null, value: string} | null} The focused text field, with its value before typing began. */
let typed = null;

/** @param {Event} event */
function keepTyped({ target }) {
  typed = target instanceof HTMLInputElement && target.type === "text" ? { field: target, value: target.value } : null;
}

/** @param {HTMLInputElement | HTMLSelectElement} field */
function readField(field) {
  return (typed?.field === field ? typed.value : field.value).trim();
}

/** @param {HTMLInputElement | HTMLSelectElement} field */
function isDefault(field) {
  return readField(field) === (field instanceof HTMLInputElement ? field.defaultValue : "") && !(isPlaced && field.name === "place");
}

/**
 * Fills in a field. If it can't have the value, such as a slider beyond its end, it gets its default.
 * @param {HTMLInputElement | HTMLSelectElement} field
 * @param {string} value
 * @returns {boolean} Whether it has the value.
 */
function writeField(field, value) {
  field.value = value;
  const isWritten = field.type === "range" ? Number(field.value) === Number(value) : field.value === value;
  if (!isWritten && field instanceof HTMLInputElement) field.value = field.defaultValue;
  return isWritten;
}

/**
 * Returns the settings that differ from the defaults, and the place if it was given, without text that is still being typed.
 * @returns {Record<string, string>}
 */
export function readSettings() {
  const fields = listFields();
  const changed = fields.filter((field) => !isDefault(field)).map((field) => [field.name, readField(field).slice(field.type === "color" ? 1 : 0)]);
  const { yaw = "0", tilt = "0", roll = "0", ...settings } = Object.fromEntries(changed);
  const rotate = [yaw, tilt, roll].join(",");
  return { ...others, ...settings, ...(rotate === "0,0,0" ? {} : { rotate }) };
}

/**
 * Returns the settings, overridden by `fields`; several yaws keep the tilt and the roll.
 * @param {Record<string, string | Blob>} fields
 */
export function mergeSettings(fields) {
  const settings = readSettings();
  const [, ...angles] = settings.rotate?.split(",") ?? [];
  const isYaw = fields.rotate && !String(fields.rotate).includes(",");
  return { ...settings, ...fields, ...(isYaw ? { rotate: [fields.rotate, ...angles].join(",") } : {}) };
}

/**
 * Fills in the form.
 * @param {Record<string, string>} settings Settings that are missing become the default.
 */
export function writeSettings(settings) {
  form.reset();
  typed = null;
  others = {};
  if (settings.model && !scales.has(settings.model)) offerModel(settings.model, [Number(settings.scale) || 2]);
  if (settings.model) form.model.value = settings.model;
  offerScales();
  for (const [name, value] of Object.entries(settings)) {
    const field = form.elements.namedItem(name);
    if (field instanceof HTMLInputElement && field.type === "color") writeColour(field, value);
    else if (name === "rotate") writeAngles(value);
    else if (field instanceof HTMLInputElement || field instanceof HTMLSelectElement) {
      if (field.closest("[data-for][hidden]") || !writeField(field, value)) others[name] = value;
    } else if (!["v", "u", "focus", "aperture"].includes(name)) others[name] = value;
  }
  isPlaced = "place" in settings && !("place" in others);
  showValues();
  markGrid();
}

/** @param {string} rotate Three angles; values that the sliders can't have, such as several yaws, are kept for the server. */
function writeAngles(rotate) {
  const angles = rotate.split(",");
  const fields = ANGLES.map((name) => form[name]);
  if (fields.map((field, index) => writeField(field, angles[index] ?? "")).every(Boolean) && angles.length === 3) return;
  for (const field of fields) field.value = field.defaultValue;
  others.rotate = rotate;
}

/**
 * @param {HTMLInputElement} field
 * @param {string} value A colour as the server accepts it, such as `ffffff`, `#fff` or `white`; the server refuses other values.
 */
function writeColour(field, value) {
  const text = value.trim().toLowerCase();
  const digits = NAMED_COLOURS[text] ?? /^#?([0-9a-f]{6}|[0-9a-f]{3})$/.exec(text)?.[1];
  if (digits) field.value = `#${digits.length === 3 ? digits.replace(/./g, "$&$&") : digits}`;
  else others[field.name] = value;
}

/** Selects the lens grid that has these settings, if it is one of those that were found. */
function markGrid() {
  const settings = readSettings();
  grids.selectedIndex = candidates.findIndex(({ options }) => Object.entries(options).every(([name, value]) => settings[name] === value));
}

/**
 * Offers the lens grids that a picture may have, and uses the likeliest unless the settings give one.
 * @param {Candidate[]} found
 * @param {Record<string, string>} settings
 */
export function offerGrids(found, settings) {
  candidates = found;
  const names = found.map(({ lenses, pixels, lens_grid: grid }) =>
    grid ? SENTENCES.rawGrid(grid.pitch, grid.rotation) : SENTENCES.grid((lenses ?? []).join("x"), pixels.join("x")),
  );
  grids.replaceChildren(...names.map((name, index) => make("option", name, { value: String(index) })));
  /** @type {HTMLElement} */ (grids.parentElement).hidden = found.length < 2;
  const isGiven = ["lenses", "pixels", "lens_pitch"].some((name) => name in settings);
  writeSettings(isGiven ? settings : { ...settings, ...found[0]?.options });
}

/**
 * Replaces the options that say where the lenses are.
 * @param {Record<string, string>} options
 */
function writeLenses(options) {
  const kept = Object.entries(readSettings()).filter(([name]) => !LENSES.includes(name));
  writeSettings({ ...Object.fromEntries(kept), ...options });
}

/**
 * Replaces the options that say where the lenses are, as if the user had changed them.
 * @param {Record<string, string>} options
 */
export function changeLenses(options) {
  writeLenses(options);
  form.dispatchEvent(new Event("change"));
}

/**
 * Shows the fields for the open input.
 * @param {string[]} input What it is: its kind, and `animated` for a mesh with an animation; empty until it is known.
 * @param {string} [views] Rows and columns of the views that were found.
 */
export function fitSettings(input, views = "") {
  const [kind = ""] = input;
  find("work", HTMLElement).dataset.kind = kind;
  for (const part of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-for]"))) {
    part.hidden = !part.dataset.for?.split(" ").some((each) => input.includes(each));
  }
  for (const field of /** @type {NodeListOf<HTMLInputElement>} */ (form.querySelectorAll("[data-usual]"))) {
    field.placeholder = kind === "mesh" || kind === "scene" ? (field.dataset.usual ?? "") : kind === "views" ? views : "";
  }
}

/**
 * Writes a number of lenses or pixels, such as `60` or `60×60`, as the server reads it.
 * @param {HTMLInputElement} field
 */
function completeSize(field) {
  const [, rows, cols] = /^\s*(\d+)\s*(?:[x×]\s*(\d+)\s*)?$/i.exec(field.value) ?? [];
  if (rows) field.value = `${rows}x${cols ?? rows}`;
}

/**
 * Clears the number of lenses that was found in the picture if the user gives that of pixels, and vice versa.
 * @param {HTMLInputElement} given
 */
function clearFound({ name, value }) {
  const other = name === "lenses" ? form.pixels : form.lenses;
  if (value && candidates.some(({ options }) => options[other.name] === other.value)) other.value = "";
}

/** @param {string} name The name of a network. @returns {HTMLOptionElement | undefined} */
function findModel(name) {
  return [...form.model.options].find(({ value }) => value === name);
}

/**
 * @param {string} name
 * @param {number[]} sizes
 * @param {string | null} [reason] Why the server can't run it.
 */
function offerModel(name, sizes, reason) {
  if (!scales.has(name)) form.model.append(make("option", MODELS[name] ?? name, { value: name }));
  scales.set(name, sizes);
  const option = findModel(name);
  if (option && reason) [option.disabled, option.title] = [true, reason];
}

/**
 * Lists the networks and interpolations of this server that make views `scale` times larger.
 * @param {number} scale
 */
export async function listModels(scale) {
  await offered;
  const fitting = [...scales].filter(([name, sizes]) => name !== "auto" && sizes.includes(scale) && !findModel(name)?.disabled);
  return fitting.map(([name]) => name);
}

/** Offers the scales of the chosen network. */
function offerScales() {
  const sizes = scales.get(form.model.value) ?? [2];
  const chosen = others.scale ?? form.scale.value;
  form.scale.replaceChildren(...sizes.map((size) => make("option", String(size))));
  if (sizes.includes(Number(chosen))) {
    form.scale.value = chosen;
    delete others.scale;
  } else if (others.scale) form.scale.selectedIndex = -1; // the server says what fits
}

/** Writes values next to the sliders, including values of the address that the sliders can't have. */
function showValues() {
  const angles = others.rotate?.split(",") ?? [];
  const given = { ...others, ...Object.fromEntries(angles.map((angle, index) => [ANGLES[index], angle])) };
  for (const field of /** @type {NodeListOf<HTMLInputElement>} */ (form.querySelectorAll("[type=range]"))) {
    const shown = field.parentElement?.querySelector(".value");
    if (shown) shown.textContent = (given[field.name] ?? field.value) + ("angle" in field.dataset ? "°" : "");
  }
  for (const part of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll("[data-with]"))) {
    part.hidden = form[part.dataset.with ?? ""].value === "";
  }
}

/** Offers the networks of the server. */
export function offerModels() {
  const offer = async () => {
    for (const { name, scales: sizes, unsupported_reason: reason } of await (await request("/v1/models")).json()) offerModel(name, sizes, reason);
    offerScales();
  };
  offered = offer().catch(() => {}); // without the list, the network is selected automatically
}

/**
 * Starts listening to events.
 * @param {() => void} changed Called when a setting has changed.
 */
export function watchSettings(changed) {
  form.model.append(make("option", TEXTS.auto, { value: "auto" }));
  offerScales();
  form.addEventListener("input", ({ target }) => {
    const name = target instanceof Element ? (target.getAttribute("name") ?? "") : "";
    delete others[ANGLES.includes(name) ? "rotate" : name];
    isPlaced ||= name === "place";
    showValues();
  });
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("focusin", keepTyped);
  form.addEventListener("focusout", () => (typed = null));
  for (const field of [form.lenses, form.pixels]) {
    field.addEventListener("change", () => {
      completeSize(field);
      clearFound(field);
    });
  }
  form.addEventListener("change", (event) => {
    keepTyped(event);
    if (event.target === form.model) offerScales();
    if (event.target === grids) writeLenses(candidates[Number(grids.value)].options);
    else markGrid();
    changed();
  });
}
