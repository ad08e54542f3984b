// @ts-check
/** The viewer alone, for an iframe: `#job=ID` shows a job of `format=tiles`, `#scene=vase&lenses=50x50` a shipped scene with settings. */
import { Job, request } from "./client.js";
import { PLACE, showLightField } from "./light_field.js";
import { PICTURE_TEXTS } from "./texts.js";

/** What the address says of the picture, not of the light field: of the viewer's place, and of the page. */
const SHOWN = [...PLACE, "show"];
const main = /** @type {HTMLElement} */ (document.querySelector("main"));

/** The light field that the address names. */
async function open() {
  const { job, ...settings } = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  if (job) return request(`/v1/reconstructions/${encodeURIComponent(job)}/result`);
  if (!settings.scene) throw new Error(PICTURE_TEXTS.nothing);
  const form = new FormData();
  const fields = { model: "none", ...settings, views: "all", format: "tiles" };
  for (const [name, value] of Object.entries(fields)) if (!SHOWN.includes(name)) form.append(name, value);
  const { signal } = new AbortController();
  return (await Job.post("reconstructions", form, signal)).follow(() => {}, signal);
}

try {
  main.textContent = PICTURE_TEXTS.making;
  await showLightField(main, await open());
} catch (error) {
  main.textContent = error instanceof Error ? error.message : String(error);
}
