// @ts-check
/** What the page opens: a shipped scene, a file, or several files that travel as one zip. */
import { Job } from "./client.js";
import { decodeImage } from "./dom.js";
import { SENTENCES, TEXTS } from "./texts.js";
import { writeZip } from "./zip.js";

/**
 * @typedef {object} Input
 * @property {string} name As the user knows it.
 * @property {string} [kind] What it is, a name in `KINDS`, once that is known.
 * @property {string} [scene] A shipped scene, in place of a file.
 * @property {File} [file]
 * @property {{name: string, file: File}[]} [parts] The files of one that holds several.
 * @property {boolean} [isFolder] Whether the name is a folder's.
 */

/** @typedef {import("./lenses.js").RawGrid} RawGrid */
/**
 * A lens grid that a picture may have.
 * @typedef {{kind: string, options: Record<string, string>, pixels: number[], lenses?: number[], lens_grid?: RawGrid}} Candidate
 */

/**
 * What an input is.
 * @typedef {object} Description
 * @property {string} kind A name in `KINDS`.
 * @property {Candidate[]} candidates The likeliest first.
 * @property {string[]} notes
 */

export const MESH = /\.(glb|vrm|gltf|ply|stl|off|obj|dae|3mf)$/i; // as `renderer/readers/registry.py`
const COMPANION = /\.(mtl|bin|png|jpe?g|webp|tga|bmp|gif|tiff?|exr|hdr|ktx2|dds)$/i; // of a mesh

/**
 * Several files are named after the folder of them all, or the mesh among them.
 * @param {{name: string, file: File}[]} files With their paths as names.
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
 * The name of an input as the page shows it.
 * @param {Input} input
 */
export function nameInput(input) {
  return input.scene ? (TEXTS[/** @type {"vase"} */ (input.scene)] ?? input.scene) : input.name;
}

/**
 * The name of an input without its suffix, which that of a folder has none of.
 * @param {Input} input
 */
export function nameStem(input) {
  return input.isFolder ? input.name : nameInput(input).replace(/\.\w+$/, "");
}

/**
 * The files that were dropped, also those in folders.
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

/** @param {HTMLInputElement} field Of files. */
export function listChosen(field) {
  return [...(field.files ?? [])].map((file) => ({ name: file.webkitRelativePath || file.name, file }));
}

/**
 * The form of a job.
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
 * What an input is: found in its content by the server.
 * @param {Input} input
 * @param {AbortSignal} signal
 * @param {Record<string, string>} [options] That say how it is read.
 * @returns {Promise<Description>}
 */
export async function describe(input, signal, options = {}) {
  if (input.scene) return { kind: "scene", candidates: [], notes: [] };
  const job = await Job.post("inspections", makeForm(input, options), signal);
  const description = await (await job.follow(() => {}, signal)).json();
  signal.throwIfAborted();
  return description;
}

/**
 * A picture, decoded.
 * @param {File | undefined} file
 * @param {() => Promise<Blob>} read Gives it where the browser doesn't read the file.
 */
export async function readImage(file, read) {
  return (file ? decodeImage(file) : Promise.reject()).catch(async () => decodeImage(await read()));
}
