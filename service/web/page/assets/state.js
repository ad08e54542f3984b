// @ts-check
/** The settings of the page in its address, after `#`, so that a link shows the same picture. */

/** @returns {Record<string, string>} */
export function readState() {
  return Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
}

/**
 * Replaces the settings in the address, without a new entry in the history.
 * @param {Record<string, string>} settings Settings with an empty text are left out.
 */
export function replaceState(settings) {
  const text = new URLSearchParams(Object.entries(settings).filter(([, value]) => value)).toString();
  history.replaceState(null, "", text ? `#${text}` : location.pathname);
}
