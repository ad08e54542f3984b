// @ts-check
/** The settings of the page in its address, after `#`: a link shows the same picture. */

/** @returns {Record<string, string>} */
export function readState() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/**
 * Changes settings in the address, without a new entry in the history.
 * @param {Record<string, string | null>} changes null or an empty text removes a setting.
 */
export function writeState(changes) {
  const kept = Object.entries({ ...readState(), ...changes }).filter(([, value]) => value);
  const text = new URLSearchParams(/** @type {[string, string][]} */ (kept)).toString();
  history.replaceState(null, "", text ? `#${text}` : location.pathname);
}
