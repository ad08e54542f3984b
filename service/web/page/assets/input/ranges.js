// @ts-check
/** The disparities of the open input, which depth planes are made of. */
import { Job } from "../job/client.js";
import { makeForm } from "./inputs.js";

/** @typedef {import("./inputs.js").Input} Input */
/** @typedef {{least: number, largest: number}} Range Disparities in pixels of the views that were read; larger is nearer. */

const MOST_BYTES = 4e6; // of a file that is sent for this alone
/** @type {WeakMap<Input, Map<string, Range>>} By input, then by the options of the job. */
const ranges = new WeakMap();

/**
 * Returns the options of a job that measures the disparities, in pixels of the views that were read.
 * @param {Record<string, string>} settings
 */
export function askDisparity({ scale, model, ...reading }) {
  return { ...reading, format: "viridis" };
}

/**
 * Keeps the range of disparities that a job has measured.
 * @param {Input} input
 * @param {Record<string, string>} settings
 * @param {Record<string, any> | undefined} report
 */
export function keepRange(input, settings, report) {
  const found = report?.disparity?.confident ?? report?.disparity;
  if (!found) return;
  const known = ranges.get(input) ?? new Map();
  ranges.set(input, known.set(JSON.stringify(askDisparity(settings)), found));
  document.dispatchEvent(new Event("range"));
}

/**
 * Returns the range of disparities with the settings, if it is known. That of a mesh is rendered, which takes some hundredths of a
 * second, but for other inputs it would have to be estimated.
 * @param {Input} input
 * @param {Record<string, string>} settings
 * @returns {Promise<Range | undefined>}
 */
export async function findRange(input, settings) {
  const readKnown = () => ranges.get(input)?.get(JSON.stringify(askDisparity(settings)));
  const isCheap = ["mesh", "scene"].includes(input.kind ?? "") && (input.file?.size ?? 0) <= MOST_BYTES;
  if (readKnown() || !isCheap) return readKnown();
  const { signal } = new AbortController();
  try {
    const job = await Job.post("disparities", makeForm(input, askDisparity(settings)), signal);
    await job.follow(() => {}, signal);
    keepRange(input, settings, job.status.report);
  } catch {} // the export says what is wrong
  return readKnown();
}
