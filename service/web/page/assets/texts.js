// @ts-check
/** Every text that the page shows. */
export const TEXTS = {
  title: "Look around in a light field",
  scene: "A shipped scene",
  file: "or a mesh, an elemental image array or views",
  lenses: "Rows x columns of lenses",
  show: "Show",
  loading: "Making the centre view",
  centre: "The centre view",
};

/** Texts of the light field, of pictures side by side, and of what is laid over them. */
export const PICTURE_TEXTS = {
  noLightField: "This is no light field in tiles. Ask for format=tiles.",
  broken: "The connection broke before all views were there. Load the light field again.",
  making: "Making the views",
  slow: "The views take long; load this page again in a minute.",
  nothing: "The address names no light field: give scene=vase and settings after #.",
};

/** Writes the texts into all elements that name one as `data-text`. */
export function writeTexts() {
  for (const element of document.querySelectorAll("[data-text]")) {
    const name = /** @type {keyof typeof TEXTS} */ (element.getAttribute("data-text"));
    element.textContent = TEXTS[name];
  }
}
