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

/** Writes the texts into all elements that name one as `data-text`. */
export function writeTexts() {
  for (const element of document.querySelectorAll("[data-text]")) {
    const name = /** @type {keyof typeof TEXTS} */ (element.getAttribute("data-text"));
    element.textContent = TEXTS[name];
  }
}
