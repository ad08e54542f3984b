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
 * @property {Record<string, string>} [fields] Options that make it.
 * @property {string[]} [needs] Options that the user gives.
 * @property {string[]} [only] The kinds of inputs that it is for.
 */

const PICTURES = ["png", "tiff", "jpeg", "webp"];
const VIDEOS = ["mp4", "webm", "gif", "animated-webp"];
const MESHES = ["mesh", "scene"];
/** Options that some formats need, with an example if there is one; those in CHOICES are one of these, those in FILES the texts of files. */
const EXAMPLES = /** @type {Record<string, string>} */ ({ stack: "-1:1:16", time: "0:1:24", rotate: "0:360:60", epi: "" });
/** Those of `renderer/displays/devices.py`. */
export const CHOICES = /** @type {Record<string, string[]>} */ ({
  device: ["portrait", "go", "16-landscape", "16-portrait", "32-landscape", "32-portrait", "65", "8.9"],
});
const FILES = /** @type {Record<string, string>} */ ({ calibration: ".json", display: ".toml" });

/** @type {Record<string, Group>} By the names of `GROUPS`, those with the same start being one group. */
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
  disparities: { kind: "disparities", formats: ["pfm", "png", "npy", "viridis", "zip", "glb", "ply"] },
};
/** Options that a kind of job has no use for, and those that it has none for if the input is a mesh. */
const USELESS = /** @type {Record<string, string[]>} */ ({ displays: ["model", "scale"], elementals: ["model", "scale"] });
const USELESS_OF_MESH = /** @type {Record<string, string[]>} */ ({
  displays: ["lenses", "pixels"],
  disparities: ["model", "scale"],
});
/** What is put after an input's name, by kinds of jobs. A quilt has its layout there, which displays read. */
const ENDS = /** @type {Record<string, string>} */ ({ reconstructions: "_view", elementals: "_eia", planes: "_plane", disparities: "_depth" });
/** Formats whose suffix is also that of others. */
const NAMED = ["eia", "mosaic", "eslf", "epi", "tiles", "mat73", "lenticular", "panel", "viridis"];

const form = find("export-form", HTMLFormElement);
const select = find("format", HTMLSelectElement);
const needed = find("needed", HTMLElement);
let isMesh = false;

/**
 * Offers the formats that an input can be written in.
 * @param {string} input What it is.
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

/** Fills in the disparity that the light field is focused on, unless the user has given another. */
function fillFocus() {
  const field = form.elements.namedItem("disparity");
  if (!(field instanceof HTMLInputElement) || field.value !== field.defaultValue) return;
  field.value = field.defaultValue = readState().focus ?? "0";
}

/**
 * Begins to listen.
 * @param {(kind: string, fields: Record<string, string | Blob>) => void} save Makes a file of what is open, with the settings as
 *   they are, over which `fields` win, and downloads it.
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
 * What a download is called after the name of its input, such as `_view`.
 * @param {string} kind Of its job.
 * @param {Record<string, string | Blob>} fields Of its form.
 */
export function nameResult(kind, { views, stack, rotate, format }) {
  const isAnimation = kind === "reconstructions" && !PICTURES.includes(String(format)); // of one view
  const animation = String(rotate).includes(":") ? "_turntable" : "_animation";
  const what = views === "all" ? "_views" : stack ? "_planes" : isAnimation ? animation : (ENDS[kind] ?? "");
  return NAMED.includes(String(format)) ? `${what}_${format}` : what;
}

/**
 * Saves a result under the name of its input, what it is, and the end of its own name: the suffix, and the layout of a quilt.
 * @param {Response} response
 * @param {string} stem As `nameStem` gives it.
 * @param {string} what As `nameResult` gives it.
 */
export async function saveResponse(response, stem, what) {
  const end = /filename="[0-9a-f]*([^"]*)"/.exec(response.headers.get("Content-Disposition") ?? "")?.[1] ?? "";
  const href = URL.createObjectURL(await response.blob());
  make("a", "", { download: stem + what + end, href }).click();
  setTimeout(() => URL.revokeObjectURL(href), 60_000); // once it is read
}
