// @ts-check
/** Downloads in every format that the server writes. */
import { find, make } from "../dom.js";
import { MAPS, PICTURES, STACKS, VIDEOS, WHOLE } from "../formats.js";
import { leaveExport } from "../job/job.js";
import { readState } from "../state.js";
import { EXAMPLES, FORMATS, GROUPS, TEXTS } from "../texts.js";

/**
 * @typedef {object} Group Formats of one kind of job.
 * @property {string} kind
 * @property {string[]} formats
 * @property {Record<string, string>} [fields] Fixed options of these jobs.
 * @property {string[]} [needs] Options that the user has to give.
 * @property {string[]} [only] The inputs for which the group is offered, as in `data-for`.
 */
/** @typedef {import("../input/ranges.js").Range} Range */

const MESHES = ["mesh", "scene"];
/** Options that some formats need, with a first value if there is one. Those in CHOICES take one of its values, and those in FILES the text of a file. */
const FIRST = /** @type {Record<string, string>} */ ({ stack: "-1:1:16", time: "0:1:24", rotate: "0:360:60", epi: "", print: "6x4in", lpi: "60", dpi: "600" });
/** The values of options that have fixed ones; the devices are those of `renderer/displays/devices.py`. */
export const CHOICES = /** @type {Record<string, string[]>} */ ({
  device: ["portrait", "go", "16-landscape", "16-portrait", "32-landscape", "32-portrait", "65", "8.9"],
});
const FILES = /** @type {Record<string, string>} */ ({ calibration: ".json", display: ".toml" });

/** @type {Record<string, Group>} Groups by their names in `GROUPS`. Entries whose first word is the same form one group. */
export const EXPORTS = {
  view: { kind: "reconstructions", formats: PICTURES },
  times: { kind: "reconstructions", formats: [...VIDEOS, "zip"], needs: ["time"], only: ["animated"] },
  turntable: { kind: "reconstructions", formats: [...VIDEOS, "zip"], needs: ["rotate"], only: MESHES },
  all: { kind: "reconstructions", formats: [...new Set(["zip", "html", "tiles", ...WHOLE])], fields: { views: "all" } },
  "all epi": { kind: "reconstructions", formats: ["epi"], fields: { views: "all" }, needs: ["epi"] },
  displays: { kind: "displays", formats: ["quilt"], needs: ["device"] },
  "displays lenticular": { kind: "displays", formats: ["lenticular"], needs: ["calibration"] },
  "displays print": { kind: "displays", formats: ["lenticular"], needs: ["print", "lpi", "dpi", "view_distance", "view_angle"] },
  "displays panel": { kind: "displays", formats: ["panel"], needs: ["display"] },
  elementals: { kind: "elementals", formats: PICTURES, only: MESHES },
  plane: { kind: "planes", formats: PICTURES, needs: ["disparity"] },
  stack: { kind: "planes", formats: STACKS, needs: ["stack"] },
  disparities: { kind: "disparities", formats: [...MAPS, "zip", "glb", "ply"] },
};
/** Options that a kind of job can't use, and options that it can't use if the input is a mesh. */
const USELESS = /** @type {Record<string, string[]>} */ ({ displays: ["model", "scale"], elementals: ["model", "scale"] });
const USELESS_OF_MESH = /** @type {Record<string, string[]>} */ ({
  displays: ["lenses", "pixels"],
  disparities: ["model", "scale"],
});
/** What follows an input's name in the name of the download, by group. For a quilt it is the layout, which displays read. */
const ENDS = /** @type {Record<string, string>} */ ({
  view: "_view", times: "_animation", turntable: "_turntable", all: "_views", elementals: "_eia", plane: "_plane", stack: "_planes", disparities: "_depth",
});
/** Formats whose suffix other formats have too. */
const NAMED = ["eia", "mosaic", "eslf", "epi", "tiles", "mat73", "lenticular", "panel", "viridis"];

const form = find("export-form", HTMLFormElement);
const select = find("format", HTMLSelectElement);
const needed = find("needed", HTMLElement);
const shown = find("shown", HTMLElement);
const HEAD = 65536; // bytes of the exported viewer, of ASCII characters, that hold its title
let isMesh = false;
/** @type {() => Promise<Range | undefined> | undefined} The disparities of the open input with the current settings, as far as they are known. */
let findRange = () => undefined;

/**
 * Offers the formats in which an input can be written.
 * @param {string[]} input What it is, as in `data-for`.
 */
export function offerFormats(input) {
  isMesh = MESHES.some((kind) => input.includes(kind));
  /** @type {Map<string, HTMLOptGroupElement>} */
  const groups = new Map();
  for (const [name, { formats, only }] of Object.entries(EXPORTS)) {
    if (only && !only.some((kind) => input.includes(kind))) continue;
    const start = name.split(" ")[0];
    const group = groups.get(start) ?? make("optgroup", "", { label: GROUPS[start] });
    const own = name === start ? undefined : FORMATS[name]; // a format's name may also be a group's, as `stack` is
    group.append(...formats.map((format) => make("option", own ?? FORMATS[format] ?? format, { value: `${name}/${format}` })));
    groups.set(start, group);
  }
  select.replaceChildren(...groups.values());
  showFields();
}

/** Shows the fields that the format needs. */
function showFields() {
  const { kind, needs = [] } = EXPORTS[select.value.split("/")[0]];
  shown.textContent = GROUPS[select.value.split(/[ /]/)[0]];
  const fields = needs.map((name) => {
    /** @type {Record<string, string>} */
    const field = name in FILES ? { type: "file", accept: FILES[name], required: "" } : { value: FIRST[name] ?? "" };
    const label = make("span", TEXTS[/** @type {keyof typeof TEXTS} */ (name)]);
    if (name in CHOICES) return make("label", [label, make("select", CHOICES[name].map((each) => make("option", each)), { name })]);
    return make("label", [label, make("input", "", { name, ...field })]);
  });
  needed.replaceChildren(...fields, ...needs.flatMap(explain));
  if (kind === "displays" && !isMesh) needed.append(offerUpscaling(), make("small", TEXTS.largerHelp, { class: "muted" }));
  void fillFocus();
}

/** Makes the box that has views upscaled before a display shows them. */
function offerUpscaling() {
  return make("label", [make("input", "", { type: "checkbox", id: "larger" }), make("span", TEXTS.larger)], { class: "check" });
}

/**
 * Makes the help for an option, with an example if it is a file.
 * @param {string} name
 */
function explain(name) {
  const text = { calibration: TEXTS.calibrationHelp, display: TEXTS.displayHelp, disparity: TEXTS.planeHelp, stack: TEXTS.stackHelp }[name];
  if (!text) return [];
  const help = make("small", text, { class: "muted", ...(name in EXAMPLES ? {} : { id: "focus-help", hidden: "" }) });
  return name in EXAMPLES ? [help, make("details", [make("summary", TEXTS.example), make("pre", EXAMPLES[name])])] : [help];
}

/** Fills in the disparities of planes, as far as they are known, unless the user has given others; without any of them, there is help. */
export async function fillFocus() {
  const field = ["disparity", "stack"].map((name) => form.elements.namedItem(name)).find((found) => found instanceof HTMLInputElement);
  if (!(field instanceof HTMLInputElement)) return;
  writeFocus(field);
  const range = await findRange();
  if (field.isConnected) writeFocus(field, range);
}

/**
 * @param {HTMLInputElement} field
 * @param {Range} [range]
 */
function writeFocus(field, range) {
  const { focus } = readState();
  const middle = focus ?? (range && ((range.least + range.largest) / 2).toFixed(2));
  const at = Number(middle ?? 0), isDeep = range && range.largest - range.least > 0.02; // more than what is rounded
  const ends = isDeep ? [range.least, range.largest] : [at - 1, at + 1];
  const value = field.name === "disparity" ? (middle ?? "0") : `${ends.map((end) => Number(end.toFixed(2))).join(":")}:16`;
  find("focus-help", HTMLElement).hidden = middle !== undefined;
  if (field.value === field.defaultValue) field.value = field.defaultValue = value;
}

/**
 * Starts listening to events.
 * @param {() => Promise<Range | undefined> | undefined} range Finds the disparities of the open input, as far as they are known.
 * @param {(kind: string, fields: Record<string, string | Blob>) => void} save Makes a file from the open input, with the current
 *   settings, which `fields` override, and downloads it.
 */
export function watchExport(range, save) {
  findRange = range;
  select.addEventListener("change", showFields);
  form.addEventListener("input", leaveExport);
  for (const name of ["rest", "range"]) document.addEventListener(name, () => void fillFocus()); // of a light field
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const [group, format] = select.value.split("/");
    const { kind, fields = {} } = EXPORTS[group];
    const given = /** @type {Record<string, string | Blob>} */ (Object.fromEntries(new FormData(form)));
    const isLarger = form.querySelector("#larger:checked") !== null;
    const useless = [...((!isLarger && USELESS[kind]) || []), ...((isMesh && USELESS_OF_MESH[kind]) || [])];
    const empty = Object.fromEntries(useless.map((option) => [option, ""]));
    save(kind, { ...empty, ...fields, ...given, format });
  });
}

/**
 * Returns the group of a job, a name in `GROUPS`.
 * @param {string} kind The kind of job.
 * @param {Record<string, string | Blob>} fields The fields of its form.
 */
export function findGroup(kind, { views, stack, rotate, format }) {
  const isAnimation = kind === "reconstructions" && !PICTURES.includes(String(format)); // of one view
  if (views === "all") return "all";
  if (isAnimation) return String(rotate).includes(":") ? "turntable" : "times";
  return { reconstructions: "view", planes: stack ? "stack" : "plane" }[kind] ?? kind;
}

/**
 * Returns what follows the name of the input in the name of a download, such as `_view`.
 * @param {string} kind The kind of its job.
 * @param {Record<string, string | Blob>} fields The fields of its form.
 */
export function nameResult(kind, fields) {
  const { format } = fields, what = ENDS[findGroup(kind, fields)] ?? "";
  if (fields.print) return "_print";
  return NAMED.includes(String(format)) ? `${what}_${format}` : what;
}

/**
 * Saves a result. Its file name consists of the input's name, the kind of result, and the end of the name that the server gives
 * it: the suffix, and the layout of a quilt.
 * @param {Response} response
 * @param {string} stem The result of `nameStem`.
 * @param {string} what The result of `nameResult`.
 * @param {string} [name] The input's name, the title of an exported viewer.
 */
export async function saveResponse(response, stem, what, name = stem) {
  const end = /filename="[0-9a-f]*([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "";
  const file = await response.blob();
  const href = URL.createObjectURL(end === ".html" ? await nameViewer(file, name) : file);
  make("a", "", { download: stem + what + end, href }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000); // once it is read
}

/**
 * Writes the name of the input into the exported viewer, as the server knows only the suffix of a file.
 * @param {Blob} page
 * @param {string} name
 */
async function nameViewer(page, name) {
  const head = await page.slice(0, HEAD).text();
  const named = head.replace(/(<title>|<h1 class="unseen">)[^<]*/g, (_, tag) => tag + make("p", name).innerHTML);
  return new Blob([named, page.slice(HEAD)], { type: page.type });
}
