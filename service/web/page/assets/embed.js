// @ts-check
/** The viewer alone, for an iframe: `#job=ID` shows a job of `format=tiles`, `#scene=vase&lenses=50x50` a shipped scene with settings. */
import { PLACE, showLightField } from "./light_field.js";
import { PICTURE_TEXTS } from "./texts.js";

const main = /** @type {HTMLElement} */ (document.querySelector("main"));

/** The light field that the address names. */
function request() {
  const { job, ...settings } = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  if (job) return fetch(`/v1/reconstructions/${encodeURIComponent(job)}/result`);
  if (!settings.scene) throw new Error(PICTURE_TEXTS.nothing);
  const form = new FormData();
  const fields = { model: "none", ...settings, views: "all", format: "tiles" };
  for (const [name, value] of Object.entries(fields)) if (!PLACE.includes(name)) form.append(name, value);
  return fetch("/v1/reconstructions", { method: "POST", body: form });
}

try {
  main.textContent = PICTURE_TEXTS.making;
  const response = await request();
  if (response.status === 202) throw new Error(PICTURE_TEXTS.slow);
  if (!response.ok) throw new Error((await response.json()).detail);
  await showLightField(main, response);
} catch (error) {
  main.textContent = error instanceof Error ? error.message : String(error);
}
