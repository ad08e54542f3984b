// @ts-check
/** Two of several pictures of one thing at the same spot, with a divider between them, a common zoom, and what differs from the truth. */
import { PICTURE_TEXTS } from "./texts.js";

const ZOOMS = [1, 2, 4, 8, 16, 32]; // screen pixels for each pixel of the largest picture
const DIFFERENCE = 4; // times which a difference is made brighter

const MARKUP = `<div class="compared"><canvas tabindex="0" role="img"></canvas><input name="divider" type="range" min="0" max="100" value="50"></div>
<div class="controls"><select name="left"></select><select name="right"></select>
<label>${PICTURE_TEXTS.zoom} <input name="zoom" type="range" min="0" max="${ZOOMS.length - 1}" value="0"></label>
<label><input name="difference" type="checkbox"> <span></span></label><p role="status"></p></div>`;

/**
 * Shows two pictures of several, the second at the right of a divider. Drag or arrow keys move what a zoom shows.
 * @param {HTMLElement} element What is in it is replaced.
 * @param {{name: string, picture: Blob}[]} pictures At least two, of any sizes, of the same view.
 * @param {Blob} [truth] What they should look like: a direct rendering of the mesh.
 */
export async function showComparison(element, pictures, truth) {
  const loaded = await Promise.all(pictures.map(async ({ name, picture }) => ({ name, bitmap: await createImageBitmap(picture) })));
  const ideal = truth && (await createImageBitmap(truth));
  const width = Math.max(...loaded.map(({ bitmap }) => bitmap.width)), height = Math.max(...loaded.map(({ bitmap }) => bitmap.height));
  element.innerHTML = MARKUP;
  element.classList.add("comparison", "light-field");
  const find = (/** @type {string} */ name) => /** @type {HTMLInputElement} */ (element.querySelector(`[name=${name}]`));
  const canvas = /** @type {HTMLCanvasElement} */ (element.querySelector("canvas"));
  const status = /** @type {HTMLElement} */ (element.querySelector("[role=status]"));
  const [left, right, divider, zoom, difference] = ["left", "right", "divider", "zoom", "difference"].map(find);
  const selects = /** @type {HTMLSelectElement[]} */ (/** @type {unknown[]} */ ([left, right]));
  for (const [name, input] of Object.entries({ left, right, divider })) {
    input.ariaLabel = PICTURE_TEXTS[/** @type {"left" | "right" | "divider"} */ (name)];
  }
  canvas.ariaLabel = PICTURE_TEXTS.compared;
  for (const select of selects) select.append(...loaded.map(({ name }, index) => new Option(name, String(index))));
  right.value = String(loaded.length - 1);
  const label = /** @type {HTMLElement} */ (difference.closest("label"));
  /** @type {HTMLElement} */ (label.querySelector("span")).textContent = PICTURE_TEXTS.difference;
  label.hidden = !ideal;
  Object.assign(canvas, { width, height });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  const measured = loaded.map(({ bitmap }) => ideal && compare(bitmap, ideal));
  let centre = [0.5, 0.5];

  const draw = () => {
    const scale = ZOOMS[Number(zoom.value)];
    centre = centre.map((each) => Math.min(Math.max(each, 0.5 / scale), 1 - 0.5 / scale));
    const border = (Number(divider.value) / 100) * width;
    context.imageSmoothingEnabled = false;
    for (const [side, select] of [left, right].entries()) {
      const index = Number(select.value);
      const shown = difference.checked && measured[index] ? measured[index].picture : loaded[index].bitmap;
      context.save();
      context.beginPath();
      context.rect(side === 0 ? 0 : border, 0, side === 0 ? border : width - border, height);
      context.clip();
      const [x, y] = [centre[0] - 0.5 / scale, centre[1] - 0.5 / scale];
      context.drawImage(shown, x * shown.width, y * shown.height, shown.width / scale, shown.height / scale, 0, 0, width, height);
      context.restore();
    }
    context.fillStyle = "#fff";
    context.fillRect(border - 1, 0, 2, height);
    const texts = [left, right].map(({ value }) => PICTURE_TEXTS.quality(loaded[Number(value)].name, measured[Number(value)]?.psnr));
    status.textContent = texts.join(" · ");
  };
  const pan = (/** @type {number} */ x, /** @type {number} */ y) => {
    const scale = ZOOMS[Number(zoom.value)];
    centre = [centre[0] + x / scale, centre[1] + y / scale];
    draw();
  };
  for (const input of [left, right, divider, zoom, difference]) input.addEventListener("input", draw);
  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons & 1) pan(-event.movementX / canvas.clientWidth, -event.movementY / canvas.clientHeight);
  });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    if (!step) return;
    event.preventDefault();
    pan(step[0], step[1]);
  });
  draw();
}

/**
 * How a picture, scaled to the truth's size, differs from it: as a picture, and as PSNR in decibels of 8-bit RGB.
 * @param {ImageBitmap} bitmap
 * @param {ImageBitmap} truth
 */
function compare(bitmap, truth) {
  const [one, other] = [bitmap, truth].map((each) => {
    const context = new OffscreenCanvas(truth.width, truth.height).getContext("2d");
    if (context) context.imageSmoothingEnabled = false; // as it is shown
    context?.drawImage(each, 0, 0, truth.width, truth.height);
    return /** @type {ImageData} */ (context?.getImageData(0, 0, truth.width, truth.height));
  });
  let sum = 0;
  for (let i = 0; i < one.data.length; i++) {
    const away = Math.abs(one.data[i] - other.data[i]);
    sum += away * away; // alpha is 255 in both
    if (i % 4 < 3) one.data[i] = DIFFERENCE * away;
  }
  const picture = new OffscreenCanvas(truth.width, truth.height);
  picture.getContext("2d")?.putImageData(one, 0, 0);
  return { picture, psnr: 10 * Math.log10((255 * 255 * 3 * truth.width * truth.height) / sum) };
}
