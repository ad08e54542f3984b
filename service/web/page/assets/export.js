// @ts-check
/** Downloads in every format that the server writes. */
import { find, make } from "./dom.js";
import { leaveExport } from "./job.js";
import { readState } from "./state.js";
import { FORMATS, GROUPS, TEXTS } from "./texts.js";

/**
 * @typedef {object} Group Formats of one kind of job.
 * @property {string} kind
 * @property {string[]} formats
 * @property {Record<string, string>} [fields] Fixed options of these jobs.
 * @property {string[]} [needs] Options that the user has to give.
 * @property {string[]} [only] The kinds of inputs for which the group is offered.
 */

const PICTURES = ["png", "tiff", "jpeg", "webp"];
const VIDEOS = ["mp4", "webm", "gif", "animated-webp"];
const MESHES = ["mesh", "scene"];
/** Options that some formats need, with an example if there is one. Those in CHOICES take one of its values, and those in FILES the text of a file. */
const EXAMPLES = /** @type {Record<string, string>} */ ({ stack: "-1:1:16", time: "0:1:24", rotate: "0:360:60", epi: "" });
/** The values of options that have fixed ones; the devices are those of `renderer/displays/devices.py`. */
export const CHOICES = /** @type {Record<string, string[]>} */ ({
  device: ["portrait", "go", "16-landscape", "16-portrait", "32-landscape", "32-portrait", "65", "8.9"],
});
const FILES = /** @type {Record<string, string>} */ ({ calibration: ".json", display: ".toml" });

/** @type {Record<string, Group>} Groups by their names in `GROUPS`. Entries whose first word is the same form one group. */
export const EXPORTS = {
  view: { kind: "reconstructions", formats: PICTURES },
  times: { kind: "reconstructions", formats: [...VIDEOS, "zip"], needs: ["time"], only: ["mesh"] },
  turntable: { kind: "reconstructions", formats: [...VIDEOS, "zip"], needs: ["rotate"], only: MESHES },
  all: {
    kind: "reconstructions",
    formats: ["zip", "html", "tiles", "npz", "eia", "mosaic", "eslf", "stack", "npy", "mat", "mat73", "hci", ...VIDEOS],
    fields: { views: "all" },
  },
  "all epi": { kind: "reconstructions", formats: ["epi"], fields: { views: "all" }, needs: ["epi"] },
  displays: { kind: "displays", formats: ["quilt"], needs: ["device"] },
  "displays lenticular": { kind: "displays", formats: ["lenticular"], needs: ["calibration"] },
  "displays panel": { kind: "displays", formats: ["panel"], needs: ["display"] },
  elementals: { kind: "elementals", formats: PICTURES, only: MESHES },
  plane: { kind: "planes", formats: PICTURES, needs: ["disparity"] },
  stack: { kind: "planes", formats: ["zip", "stack", "npy", "npz", ...VIDEOS], needs: ["stack"] },
  disparities: { kind: "disparities", formats: ["pfm", "tiff", "png", "npy", "viridis", "zip", "glb", "ply"] },
};
/** Options that a kind of job can't use, and options that it can't use if the input is a mesh. */
const USELESS = /** @type {Record<string, string[]>} */ ({ displays: ["model", "scale"], elementals: ["model", "scale"] });
const USELESS_OF_MESH = /** @type {Record<string, string[]>} */ ({
  displays: ["lenses", "pixels"],
  disparities: ["model", "scale"],
});
/** What follows an input's name in the name of the download, by kind of job. For a quilt it is the layout, which displays read. */
const ENDS = /** @type {Record<string, string>} */ ({ reconstructions: "_view", elementals: "_eia", planes: "_plane", disparities: "_depth" });
/** Formats whose suffix other formats have too. */
const NAMED = ["eia", "mosaic", "eslf", "epi", "tiles", "mat73", "lenticular", "panel", "viridis"];

const form = find("export-form", HTMLFormElement);
const select = find("format", HTMLSelectElement);
const needed = find("needed", HTMLElement);
let isMesh = false;

/**
 * Offers the formats in which an input can be written.
 * @param {string} input The kind of input.
 */
export function offerFormats(input) {
  isMesh = MESHES.includes(input);
  /** @type {Map<string, HTMLOptGroupElement>} */
  const groups = new Map();
  for (const [name, { formats, only }] of Object.entries(EXPORTS)) {
    if (only && !only.includes(input)) continue;
    const start = name.split(" ")[0];
    const group = groups.get(start) ?? make("optgroup", "", { label: GROUPS[start] });
    group.append(...formats.map((format) => make("option", FORMATS[format] ?? format, { value: `${name}/${format}` })));
    groups.set(start, group);
  }
  select.replaceChildren(...groups.values());
  showFields();
}

/** Shows the fields that the format needs. */
function showFields() {
  const { needs = [] } = EXPORTS[select.value.split("/")[0]];
  const fields = needs.map((name) => {
    /** @type {Record<string, string>} */
    const field = name in FILES ? { type: "file", accept: FILES[name], required: "" } : { value: EXAMPLES[name] ?? "" };
    const label = make("span", TEXTS[/** @type {keyof typeof TEXTS} */ (name)]);
    if (name in CHOICES) return make("label", [label, make("select", CHOICES[name].map((each) => make("option", each)), { name })]);
    return make("label", [label, make("input", "", { name, ...field })]);
  });
  needed.replaceChildren(...fields);
  fillFocus();
}

/** Fills in the disparity at which the light field is focused, unless the user has given another. */
function fillFocus() {
  const field = form.elements.namedItem("disparity");
  if (!(field instanceof HTMLInputElement) || field.value !== field.defaultValue) return;
  field.value = field.defaultValue = readState().focus ?? "0";
}

/**
 * Starts listening to events.
 * @param {(kind: string, fields: Record<string, string | Blob>) => void} save Makes a file from the open input, with the current
 *   settings, which `fields` override, and downloads it.
 */
export function watchExport(save) {
  select.addEventListener("change", showFields);
  form.addEventListener("input", leaveExport);
  document.addEventListener("rest", fillFocus); // of a light field
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const [group, format] = select.value.split("/");
    const { kind, fields = {} } = EXPORTS[group];
    const given = /** @type {Record<string, string | Blob>} */ (Object.fromEntries(new FormData(form)));
    const useless = [...(USELESS[kind] ?? []), ...((isMesh && USELESS_OF_MESH[kind]) || [])];
    const empty = Object.fromEntries(useless.map((option) => [option, ""]));
    save(kind, { ...empty, ...fields, ...given, format });
  });
}

/**
 * Returns what follows the name of the input in the name of a download, such as `_view`.
 * @param {string} kind The kind of its job.
 * @param {Record<string, string | Blob>} fields The fields of its form.
 */
export function nameResult(kind, { views, stack, rotate, format }) {
  const isAnimation = kind === "reconstructions" && !PICTURES.includes(String(format)); // of one view
  const animation = String(rotate).includes(":") ? "_turntable" : "_animation";
  const what = views === "all" ? "_views" : stack ? "_planes" : isAnimation ? animation : (ENDS[kind] ?? "");
  return NAMED.includes(String(format)) ? `${what}_${format}` : what;
}

/**
 * Saves a result. Its file name consists of the input's name, the kind of result, and the end of the name that the server gives
 * it: the suffix, and the layout of a quilt.
 * @param {Response} response
 * @param {string} stem The result of `nameStem`.
 * @param {string} what The result of `nameResult`.
 */
export async function saveResponse(response, stem, what) {
  const end = /filename="[0-9a-f]*([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "";
  const href = URL.createObjectURL(await response.blob());
  make("a", "", { download: stem + what + end, href }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000); // once it is read
}
