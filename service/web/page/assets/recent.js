// @ts-check
/** The jobs of this tab, newest first. */
import { find, make } from "./dom.js";
import { keep, read } from "./storage.js";
import { SENTENCES } from "./texts.js";

const KEY = "recent";
const MOST = 8;

/** @type {(entry: Entry) => void} */
let open = () => {};

/** @typedef {{name: string, what: string, url: string, hash: string}} Entry Of what, the job's path, and the page's settings. */

/** @returns {Entry[]} */
function readJobs() {
  return JSON.parse(read(KEY) ?? "[]");
}

/** @param {Entry} entry */
export function keepJob(entry) {
  const others = readJobs().filter(({ url }) => url !== entry.url);
  keep(KEY, JSON.stringify([entry, ...others].slice(0, MOST)));
  showJobs();
}

/**
 * Lists the jobs.
 * @param {(entry: Entry) => void} chosen Called with the one that is chosen.
 */
export function watchRecent(chosen) {
  open = chosen;
  showJobs();
}

function showJobs() {
  const entries = readJobs();
  find("recent", HTMLElement).hidden = entries.length === 0;
  const items = entries.map((entry) => {
    const button = make("button", SENTENCES.job(entry.what, entry.name), { type: "button" });
    button.addEventListener("click", () => open(entry));
    return make("li", [button]);
  });
  find("recent-list", HTMLElement).replaceChildren(...items);
}
