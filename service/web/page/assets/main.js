// @ts-check
/** The page: a file or a shipped scene is chosen, and its centre view is shown as mapped. */
import { post } from "./client.js";
import { TEXTS, writeTexts } from "./texts.js";

const form = /** @type {HTMLFormElement} */ (document.querySelector("#input"));
const file = /** @type {HTMLInputElement} */ (document.querySelector("#file"));
const scene = /** @type {HTMLSelectElement} */ (document.querySelector("#scene"));
const lenses = /** @type {HTMLInputElement} */ (document.querySelector("#lenses"));
const status = /** @type {HTMLElement} */ (document.querySelector("[role=status]"));
const view = /** @type {HTMLImageElement} */ (document.querySelector("#view"));

writeTexts();
form.addEventListener("submit", async (event) => {
  event.preventDefault();
  const fields = new FormData();
  fields.append("scene", scene.value); // the server ignores empty fields
  if (file.files?.length) fields.append("file", file.files[0]);
  fields.append("lenses", lenses.value);
  fields.append("model", "none");
  status.textContent = TEXTS.loading;
  try {
    const picture = await post("reconstructions", fields);
    URL.revokeObjectURL(view.src);
    view.src = URL.createObjectURL(picture);
    view.alt = status.textContent = TEXTS.centre;
    view.hidden = false;
  } catch (error) {
    status.textContent = error instanceof Error ? error.message : String(error);
  }
});
