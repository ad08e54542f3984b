// @ts-check
/** The viewer alone, for an iframe. `#job=ID` shows a job of `format=tiles`, `#scene=vase&lenses=50x50` a shipped scene with settings. */
import { make } from "./dom.js";
import { describeError, Job, Problem, request } from "./job/client.js";
import { PLACE, showLightField } from "./results/light_field.js";
import { PICTURE_TEXTS, SENTENCES, writeTexts } from "./texts.js";

/** Settings in the address that concern the viewpoint and the page, not the light field. */
const SHOWN = [...PLACE, "show"];
const holder = /** @type {HTMLElement} */ (document.querySelector("main > div"));

/** @param {string} text Replaces the content. */
function show(text) {
  holder.replaceChildren(make("p", text, { role: "status" }));
}

/** @param {import("./job/client.js").Status} status */
function showProgress({ progress }) {
  if (progress && progress.views > 1) show(`${PICTURE_TEXTS.making}: ${SENTENCES.views(progress.views_done, progress.views)}`);
}

/**
 * Fetches the result of a job.
 * @param {string} id
 */
async function fetchResult(id) {
  return request(`/v1/reconstructions/${encodeURIComponent(id)}/result`).catch((error) => {
    throw error instanceof Problem && [404, 410].includes(error.status) ? new Error(PICTURE_TEXTS.noJob) : error;
  });
}

/** Opens the light field that the address names. */
async function open() {
  const { job, ...settings } = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  if (job) return fetchResult(job);
  if (!settings.scene) throw new Error(PICTURE_TEXTS.nothing);
  const form = new FormData();
  const fields = { model: "none", ...settings, views: "all", format: "tiles" };
  for (const [name, value] of Object.entries(fields)) if (!SHOWN.includes(name)) form.append(name, value);
  const { signal } = new AbortController();
  return (await Job.post("reconstructions", form, signal)).follow(showProgress, signal);
}

writeTexts();
try {
  show(PICTURE_TEXTS.making);
  await showLightField(holder, await open());
} catch (error) {
  show(describeError(error));
}
