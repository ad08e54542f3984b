// @ts-check
/** The jobs of this tab, newest first. */
import { find, make } from "./dom.js";
import { SENTENCES } from "./texts.js";

const KEY = "recent";
const MOST = 8;

/** @typedef {{name: string, what: string, url: string, hash: string}} Entry Of what, the job's path, and the page's settings. */

/** @returns {Entry[]} */
function read() {
  return JSON.parse(sessionStorage.getItem(KEY) ?? "[]");
}

/** @param {Entry} entry */
export function keepJob(entry) {
  const others = read().filter(({ url }) => url !== entry.url);
  sessionStorage.setItem(KEY, JSON.stringify([entry, ...others].slice(0, MOST)));
}

/**
 * Lists the jobs.
 * @param {(entry: Entry) => void} open Called with the one that is chosen.
 */
export function showRecent(open) {
  const entries = read();
  find("recent", HTMLElement).hidden = entries.length === 0;
  const items = entries.map((entry) => {
    const button = make("button", SENTENCES.job(entry.what, entry.name), { type: "button" });
    button.addEventListener("click", () => open(entry));
    return make("li", [button]);
  });
  find("recent-list", HTMLElement).replaceChildren(...items);
}
