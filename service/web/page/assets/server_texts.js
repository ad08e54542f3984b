// @ts-check
/** Texts of the page on what the server reports: problems, stages, states, and the remedies that the page has. */
import { GROUPS, TEXTS } from "./texts.js";

/** The messages for problems, by HTTP status; 0: the server did not answer. */
export const PROBLEMS = /** @type {Record<number, string>} */ ({
  0: "The server does not answer. Check that it runs, then try again.",
  400: "The server did not understand the request.",
  401: "This server needs a key.",
  403: "The server refuses requests from this page's address.",
  404: "The server no longer has this job. Open the file again.",
  408: "The upload took too long. Try a smaller file or a faster connection.",
  409: "The job was cancelled.",
  410: "The server no longer keeps this. Open the file again.",
  413: "This exceeds a limit of the server.",
  415: "The server can't read this file.",
  422: "The file or a setting does not fit.",
  429: "The server is busy. Try again in a few seconds.",
  500: "The server failed.",
  503: "The server is not ready. Try again in a few seconds.",
});

/** The names of a job's stages, in the order in which they run. */
export const STAGES = /** @type {Record<string, string>} */ ({
  decode: "Reading",
  plan: "Planning",
  render: "Rendering",
  map: "Mapping",
  upscale: "Upscaling",
  focus: "Focusing",
  encode: "Writing",
});

/** The states of jobs that are not done, in the list of recent jobs. */
export const STATES = /** @type {Record<string, string>} */ ({ queued: "waiting", running: "running", failed: "failed" });

/**
 * Names a choice of the settings.
 * @param {string} choice
 * @param {string} field
 */
function nameChoice(choice, field) {
  const texts = /** @type {Record<string, string>} */ (TEXTS);
  return `"${texts[choice]}" under "${texts[field]}"`;
}

/** @param {string} size Bytes, with commas. */
function writeMegabytes(size) {
  return `${(Number(size.replace(/\D/g, "")) / 1e6).toLocaleString("en-GB", { maximumFractionDigits: 1 })} MB`;
}

/** Remedies on the page, which replace remedies of the server that are for other programs. */
const REMEDIES = /** @type {[RegExp, string | ((found: string, part: string) => string)][]} */ ([
  [
    /^\w+: .*(several times or yaws|make a video of one view).*/,
    `Several times or turns make a video: choose "${GROUPS.times}" or "${GROUPS.turntable}" under ${TEXTS.export}. One time has a decimal point, as 0.5.`,
  ],
  [/; if the object lies down, give up z$/, `; if the object lies down, choose "${TEXTS.z}" under "${TEXTS.up}"`],
  [/; put it next to the mesh, or give a zip that holds both/, "; drop it together with the mesh, or a zip that holds both"],
  [/\border (given|rows|columns|serpentine)\b/g, (_, name) => nameChoice(name, "order")],
  [/\btranspose(?=,| and | with | would |$)/, () => nameChoice("swapped", "transpose")],
  [/\bflip (uv?|v)\b/g, (_, axes) => nameChoice(axes, "flip")],
  [/\bdepth_sense (cameras|lenses)\b/, (_, sense) => nameChoice(sense === "lenses" ? "underLenses" : sense, "depth_sense")],
  [/\bpixels(?= 1x\d+ takes| gives)|\bpixels ROWSxCOLUMNS( \(of views\)| of the views)?/, `"${TEXTS.viewGrid}"`],
  [/(?<=over |limit of |more than )[\d,]{7,} bytes|[\d,]{7,} bytes(?=; at most)|(?<=bytes; at most )[\d,]{7,}(?= are read)/g, writeMegabytes],
  [/(type \.(7z|bz2|rar|tar|t?gz|xz) are not read); .*/, "$1; unpack it, and drop what is in it"],
]);

/**
 * Returns an error or a note of the server with the remedy that helps on the page.
 * @param {string} text
 */
export function adaptRemedy(text) {
  if (/: no such field;/.test(text)) return text; // whose remedy lists the names of the address
  return REMEDIES.reduce((adapted, [pattern, remedy]) => adapted.replace(pattern, /** @type {any} */ (remedy)), text);
}
