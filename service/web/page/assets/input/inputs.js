// @ts-check
/** Inputs of the page: a shipped scene, a file, or several files that are sent as one zip. */
import { decodeImage } from "../dom.js";
import { Job } from "../job/client.js";
import { run } from "../job/job.js";
import { SENTENCES, TEXTS } from "../texts.js";
import { writeZip } from "./zip.js";

/**
 * @typedef {object} Input
 * @property {string} name The name that the user knows.
 * @property {string} [kind] The kind of input, a name in `KINDS`, once that is known.
 * @property {string} [scene] A shipped scene, instead of a file.
 * @property {File} [file]
 * @property {{name: string, file: File}[]} [parts] The files, if there are several.
 * @property {boolean} [isFolder] Whether the name is a folder's.
 */

/** @typedef {import("./lenses.js").RawGrid} RawGrid */
/**
 * A lens grid that a picture may have.
 * @typedef {{kind: string, options: Record<string, string>, pixels: number[], lenses?: number[], lens_grid?: RawGrid}} Candidate
 */

/**
 * The description of an input.
 * @typedef {object} Description
 * @property {string} kind A name in `KINDS`.
 * @property {Candidate[]} candidates The likeliest one comes first.
 * @property {string[]} notes
 * @property {{rows: number, cols: number}} [light_field] Rows and columns of views.
 * @property {Error} [error] Why the user has to give rows and columns of views.
 */

export const MESH = /\.(glb|vrm|gltf|ply|stl|off|obj|dae|3mf)$/i; // as in `renderer/readers/registry.py`
const GLB = 0x46546c67; // "glTF"
const COMPANION = /\.(mtl|bin|png|jpe?g|webp|p[pgn]m|tga|bmp|gif|tiff?|exr|hdr|ktx2|dds)$/i; // files that belong to a mesh

/**
 * Joins files to one input. Several files are named after their common folder, or after the mesh among them.
 * @param {{name: string, file: File}[]} files Files with their paths as names.
 * @returns {Promise<Input>}
 */
export async function joinFiles(files) {
  if (files.length === 0) throw new Error(TEXTS.noFiles);
  if (files.length === 1) return { name: files[0].name, file: files[0].file };
  const sorted = [...files].sort((a, b) => (a.name < b.name ? -1 : 1)); // the same files are the same job
  const meshes = sorted.filter((each) => MESH.test(each.name)), others = sorted.filter((each) => !COMPANION.test(each.name));
  const main = [meshes, others].find((each) => each.length === 1)?.[0].name.split("/").at(-1);
  const [folder] = sorted[0].name.split("/");
  const isFolder = sorted.every((each) => each.name.startsWith(`${folder}/`));
  const name = isFolder ? folder : (main ?? SENTENCES.files(sorted.length));
  return { name, file: new File([await writeZip(sorted)], `${name}.zip`), parts: sorted, isFolder };
}

/**
 * Returns the name of an input as the page shows it.
 * @param {Input} input
 */
export function nameInput(input) {
  return input.scene ? (TEXTS[/** @type {"vase"} */ (input.scene)] ?? input.scene) : input.name;
}

/**
 * Returns the name of an input without its suffix; the name of a folder has none.
 * @param {Input} input
 */
export function nameStem(input) {
  return input.isFolder ? input.name : nameInput(input).replace(/\.\w+$/, "");
}

/**
 * Lists the files that were dropped, including those in folders.
 * @param {DataTransfer} dropped
 */
export async function listDropped(dropped) {
  const entries = [...dropped.items].flatMap((item) => item.webkitGetAsEntry() ?? []);
  return (await Promise.all(entries.map(listEntry))).flat();
}

/**
 * @param {FileSystemEntry} entry
 * @returns {Promise<{name: string, file: File}[]>}
 */
async function listEntry(entry) {
  if (entry.isFile) {
    const file = await new Promise((resolve, reject) => /** @type {FileSystemFileEntry} */ (entry).file(resolve, reject));
    return [{ name: entry.fullPath.slice(1), file }];
  }
  const reader = /** @type {FileSystemDirectoryEntry} */ (entry).createReader();
  /** @type {FileSystemEntry[]} */
  const entries = [];
  for (;;) {
    const some = await new Promise((resolve, reject) => reader.readEntries(resolve, reject)); // up to 100 at a time
    if (some.length === 0) break;
    entries.push(...some);
  }
  return (await Promise.all(entries.map(listEntry))).flat();
}

/** @param {HTMLInputElement} field A field for files. */
export function listChosen(field) {
  return [...(field.files ?? [])].map((file) => ({ name: file.webkitRelativePath || file.name, file }));
}

/**
 * Makes the form of a job.
 * @param {Input} input
 * @param {Record<string, string | Blob>} fields
 */
export function makeForm(input, fields) {
  const form = new FormData();
  if (input.scene) form.append("scene", input.scene);
  else if (input.file) form.append("file", input.file);
  for (const [name, value] of Object.entries(fields)) if (value) form.append(name, value);
  return form;
}

/**
 * Describes an input, whose content the server inspects.
 * @param {Input} input
 * @param {AbortSignal} signal
 * @param {Record<string, string>} [options] Options that say how it is read.
 * @returns {Promise<Description>}
 */
export async function describe(input, signal, options = {}) {
  if (input.scene) return { kind: "scene", candidates: [], notes: [] };
  const start = (/** @type {(share: number) => void} */ report) => Job.post("inspections", makeForm(input, options), signal, report);
  const description = await (await run(start, TEXTS.reading, signal)).response.json();
  signal.throwIfAborted();
  return description;
}

/**
 * Whether a mesh has an animation, as far as the browser can tell: in a zip it may have one.
 * @param {Input} input
 */
export async function isAnimated({ name, file, parts }) {
  const files = parts ?? (file ? [{ name, file }] : []);
  if (files.some((each) => /\.zip$/i.test(each.name))) return true;
  const main = files.find((each) => /\.(glb|vrm|gltf)$/i.test(each.name));
  if (!main) return false;
  try {
    const [magic, , , length] = new Uint32Array(await main.file.slice(0, 16).arrayBuffer()); // glTF 2.0, section 4.4
    const text = magic === GLB ? main.file.slice(20, 20 + length) : main.file;
    return (JSON.parse(await text.text()).animations ?? []).length > 0;
  } catch {
    return true; // the server knows
  }
}

/**
 * Decodes a picture.
 * @param {File | undefined} file
 * @param {() => Promise<Blob>} read Makes the picture if the browser can't read the file.
 */
export async function readImage(file, read) {
  return (file ? decodeImage(file) : Promise.reject()).catch(async () => decodeImage(await read()));
}
