// @ts-check
/** Keeps texts in the browser, as long as the tab is open or longer; in memory if the browser refuses that. */

/** @typedef {"sessionStorage" | "localStorage"} Place Keeps texts as long as the tab is open, or until they are removed. */

/** @type {Map<string, string>} */
const memory = new Map();

/**
 * @param {string} name
 * @param {Place} [place]
 * @returns {string | null}
 */
export function read(name, place = "sessionStorage") {
  try {
    return window[place].getItem(name);
  } catch {
    return memory.get(name) ?? null;
  }
}

/**
 * @param {string} name
 * @param {string} text
 * @param {Place} [place]
 */
export function keep(name, text, place = "sessionStorage") {
  try {
    window[place].setItem(name, text);
  } catch {
    memory.set(name, text);
  }
}
