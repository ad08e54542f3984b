// @ts-check
/** Texts that the browser keeps, for the tab or longer; in memory where it refuses that. */

/** @typedef {"sessionStorage" | "localStorage"} Place As long as the tab, or until it is removed. */

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
