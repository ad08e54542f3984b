// @ts-check
/** Requests to the HTTP API of this server, with the API key if one is set; it is kept as long as the tab. */

const KEY = "key";

/** @param {string} key Empty to forget it. */
export function setKey(key) {
  sessionStorage.setItem(KEY, key);
}

/**
 * Posts a job and waits for its result.
 * @param {string} kind Such as `reconstructions`.
 * @param {FormData} form
 * @returns {Promise<Blob>}
 * @throws {Error} With the `detail` of the server's problem.
 */
export async function post(kind, form) {
  const key = sessionStorage.getItem(KEY);
  const response = await fetch(`/v1/${kind}`, { method: "POST", body: form, headers: key ? { "X-API-Key": key } : {} });
  if (response.status !== 200) throw new Error((await response.json()).detail);
  return response.blob();
}
