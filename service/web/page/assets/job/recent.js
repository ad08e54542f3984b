// @ts-check
/** The last jobs of this browser, newest first. */
import { find, make } from "../dom.js";
import { STATES } from "../server_texts.js";
import { keep, read } from "../storage.js";
import { FORMATS, GROUPS, SENTENCES, TEXTS } from "../texts.js";
import { Problem, request } from "./client.js";

const KEY = "recent", PLACE = "localStorage";
const MOST = 20;
const UNLISTED = /^(views|format|arrangement|lens_.*)$/; // settings of little interest

/** @type {(entry: Entry) => void} */
let open = () => {};

/**
 * @typedef {object} Made A job and its result.
 * @property {string} name The name of its input.
 * @property {string} what The kind of result.
 * @property {string} [stem] The first part of its download's name.
 * @property {string} [end] The second part of its download's name.
 * @property {string} [group] What it shows, a name in `GROUPS`.
 * @property {string} url Its path.
 * @property {string} hash The page's settings.
 * @property {string} [state] Its last known state.
 */
/** @typedef {Made & {details: string[], time: number}} Entry A job with the time when it began and the details that tell it from others. */

/** @returns {Entry[]} Only well-formed ones: all pages of one host and port share the storage, including those of other programs. */
function readJobs() {
  try {
    return JSON.parse(read(KEY, PLACE) ?? "[]").filter(isEntry);
  } catch {
    return [];
  }
}

/** @param {Entry} entry */
function isEntry({ name, what, url, hash, details, time }) {
  return [name, what, url, hash].every((text) => typeof text === "string") && Array.isArray(details) && Number.isSafeInteger(time);
}

/** @param {Entry[]} entries */
function keepJobs(entries) {
  keep(KEY, JSON.stringify(entries.slice(0, MOST)), PLACE);
  showJobs();
}

/**
 * @param {Made} made
 * @param {Record<string, string | Blob>} fields The fields of its form.
 */
export function keepJob(made, fields) {
  const format = String(fields.format);
  const file = made.what === TEXTS.export ? [(GROUPS[made.group ?? ""] ?? "").toLowerCase(), FORMATS[format] ?? format] : [];
  if (made.group === "displays" && fields.model) file.push(TEXTS.upscaled.toLowerCase());
  const settings = Object.entries(fields).filter(([name, value]) => value && typeof value === "string" && !UNLISTED.test(name));
  const details = [...file, ...settings.map(([name, value]) => SENTENCES.setting(name, String(value)))].filter((text) => text);
  keepJobs([{ ...made, details, time: Date.now() }, ...readJobs().filter(({ url }) => url !== made.url)]);
}

/** @param {Entry} entry */
export function isUnfinished({ state = "" }) {
  return ["queued", "running"].includes(state);
}

/**
 * Stores the state of a job that is listed as not done, and removes it from the list if it was cancelled.
 * @param {string} url
 * @param {string} state
 */
export function markJob(url, state) {
  const entries = readJobs();
  const entry = entries.find((each) => each.url === url);
  if (!entry?.state || entry.state === "done" || entry.state === state) return;
  entry.state = state;
  keepJobs(entries.filter((each) => each.state !== "cancelled"));
}

/**
 * Asks the server for the state of a job that was left unfinished when its page was closed.
 * @param {Entry} entry
 */
async function readState({ url }) {
  try {
    markJob(url, (await (await request(url)).json()).state);
  } catch (error) {
    if (error instanceof Problem && error.status === 404) forgetJob(url);
  }
}

/** @param {string} url The path of a job that the server no longer has. */
export function forgetJob(url) {
  keepJobs(readJobs().filter((entry) => entry.url !== url));
}

/**
 * Lists the jobs.
 * @param {(entry: Entry) => void} chosen Called with the job that the user chooses.
 */
export function watchRecent(chosen) {
  open = chosen;
  find("forget", HTMLButtonElement).addEventListener("click", () => keepJobs([]));
  addEventListener("storage", showJobs); // another tab has changed them
  showJobs();
  for (const entry of readJobs().filter(isUnfinished)) void readState(entry);
}

function showJobs() {
  const entries = readJobs();
  find("recent", HTMLElement).hidden = entries.length === 0;
  const items = entries.map((entry) => {
    const state = STATES[entry.state ?? ""] ?? "";
    const text = [SENTENCES.job(entry.what, entry.name), ...entry.details, state].filter((each) => each).join(", ");
    const time = make("time", SENTENCES.date(entry.time), { datetime: new Date(entry.time).toISOString(), class: "muted" });
    const button = make("button", [make("span", text), time], { type: "button" });
    button.addEventListener("click", () => {
      open(entry);
      find("name", HTMLElement).focus(); // the button is gone, as the list is rebuilt
    });
    return make("li", [button]);
  });
  find("recent-list", HTMLElement).replaceChildren(...items);
}
