// @ts-check
/** Finds elements by id and makes new ones; texts never become markup. */

/**
 * Returns the element with an id.
 * @template {HTMLElement} T
 * @param {string} id
 * @param {new () => T} type
 * @returns {T}
 */
export function find(id, type) {
  const found = document.getElementById(id);
  if (!(found instanceof type)) throw new TypeError(id);
  return found;
}

/**
 * Makes a new element.
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {string | Node[]} [content] A text, or children.
 * @param {Record<string, string>} [attributes]
 * @returns {HTMLElementTagNameMap[T]}
 */
export function make(tag, content = "", attributes = {}) {
  const element = document.createElement(tag);
  if (typeof content === "string") element.textContent = content;
  else element.append(...content);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
}

/**
 * Makes an image of a picture and decodes it.
 * @param {Blob} picture
 * @param {Record<string, string>} [attributes]
 */
export async function decodeImage(picture, attributes) {
  const image = make("img", "", attributes);
  image.src = URL.createObjectURL(picture);
  await image.decode().finally(() => URL.revokeObjectURL(image.src));
  return image;
}
