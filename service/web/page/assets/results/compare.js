// @ts-check
/** Compares two of several pictures of one view at the same spot, with a divider, a common zoom, and the difference from the truth. */
import { make } from "../dom.js";
import { describeError, isEnded } from "../job/client.js";
import { PICTURE_TEXTS } from "../texts.js";
import { followGestures } from "./gestures.js";
import { measureQuality } from "./score.js";

const FEWEST = 8; // pixels of the largest picture across the frame at the strongest zoom
const DIFFERENCE = 4; // factor by which a difference is made brighter

/** @typedef {{name: string, make: (signal: AbortSignal) => Promise<Blob>}} Way A way to make a picture of the view. */
/** @typedef {{picture: HTMLCanvasElement, difference?: HTMLCanvasElement, quality?: {psnr: number, ssim: number}}} Made */

/**
 * Shows two of several pictures, the second to the right of a divider.
 * @param {HTMLElement} element Its content is replaced.
 * @param {Way[]} ways Pictures of different sizes are shown in the size of the largest. Each is made when it is first shown.
 * @param {[number, number]} shown The ways that are shown first.
 * @param {Blob | undefined} truth The ideal picture: a direct rendering of the mesh.
 * @param {AbortSignal} signal Ends the work on the first two pictures.
 * @param {(action: (signal: AbortSignal) => Promise<void>) => Promise<void>} perform Makes other pictures in place of those that are being made.
 */
export async function showComparison(element, ways, shown, truth, signal, perform) {
  const ideal = truth && (await readPicture(truth));
  /** @type {Map<string, Made>} */
  const made = new Map();
  const choose = ["left", "right"].map((name, side) => {
    const options = ways.map((way, index) => make("option", way.name, { value: String(index) }));
    const select = make("select", options, { name, "aria-label": PICTURE_TEXTS[/** @type {"left" | "right"} */ (name)] });
    select.value = String(shown[side]);
    return select;
  });
  const sides = choose.map(({ name }) => make("div", "", { class: `half ${name}` }));
  const pictures = make("div", sides, { class: "pictures", tabindex: "0", role: "img", "aria-label": PICTURE_TEXTS.compared });
  const divider = make("input", "", { name: "divider", type: "range", step: "any", "aria-label": PICTURE_TEXTS.divider });
  const zoom = make("input", "", { name: "zoom", type: "range", min: "0", step: "0.1", value: "0" });
  const difference = make("input", "", { name: "difference", type: "checkbox" });
  const status = make("p", "", { role: "status" });
  const differenceLabel = make("label", [difference, make("span", PICTURE_TEXTS.difference)]);
  differenceLabel.hidden = !ideal;
  const frame = make("div", [pictures, divider], { class: "compared" });
  const zoomLabel = make("label", [make("span", PICTURE_TEXTS.zoom), zoom]);
  element.replaceChildren(frame, make("div", [...choose, status, zoomLabel, differenceLabel], { class: "controls" }));
  element.classList.add("comparison", "light-field");

  const place = followGestures(pictures, zoom);
  const divide = () => frame.style.setProperty("--divider", `${divider.value}%`);
  const findWanted = () => choose.map(({ value }) => ways[Number(value)]);
  const load = async (/** @type {AbortSignal} */ signal) => {
    for (const way of findWanted()) {
      if (!made.has(way.name)) made.set(way.name, judge(await readPicture(await way.make(signal)), ideal));
    }
  };
  const show = () => {
    const wanted = findWanted();
    const found = wanted.map(({ name }) => /** @type {Made} */ (made.get(name)));
    const width = Math.max(...found.map(({ picture }) => picture.width)), height = Math.max(...found.map(({ picture }) => picture.height));
    element.style.setProperty("--ratio", String(width / height));
    zoom.max = String(Math.max(0, Math.log2(width / FEWEST)));
    place();
    for (const [side, each] of found.entries()) {
      const canvas = (difference.checked && each.difference) || each.picture;
      sides[side].replaceChildren(side === 1 && found[0] === each ? copy(canvas, canvas.width, canvas.height) : canvas);
    }
    status.replaceChildren(...wanted.map(({ name }, side) => make("span", PICTURE_TEXTS.quality(name, found[side].quality))));
  };
  const change = async () => {
    try {
      if (!findWanted().every(({ name }) => made.has(name))) await perform(load);
      show();
    } catch (error) {
      if (!isEnded(error)) status.textContent = describeError(error);
    }
  };
  for (const input of [...choose, difference]) input.addEventListener("input", change);
  divider.addEventListener("input", divide);
  divide();
  await load(signal);
  show();
}

/** @param {Blob} blob */
async function readPicture(blob) {
  const bitmap = await createImageBitmap(blob);
  const picture = copy(bitmap, bitmap.width, bitmap.height);
  bitmap.close();
  return picture;
}

/**
 * @param {ImageBitmap | HTMLCanvasElement} picture
 * @param {number} width
 * @param {number} height
 */
function copy(picture, width, height) {
  const canvas = make("canvas", "", { width: String(width), height: String(height) });
  const context = draw(canvas);
  context.imageSmoothingEnabled = false; // as it is shown
  context.drawImage(picture, 0, 0, width, height);
  return canvas;
}

/** @param {HTMLCanvasElement} canvas */
function draw(canvas) {
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error(PICTURE_TEXTS.noCanvas);
  return context;
}

/**
 * Returns a picture with its difference from the truth, in the truth's size.
 * @param {HTMLCanvasElement} picture
 * @param {HTMLCanvasElement} [truth]
 * @returns {Made}
 */
function judge(picture, truth) {
  if (!truth) return { picture };
  const { width, height } = truth;
  const difference = copy(picture, width, height);
  const [one, other] = [difference, truth].map((each) => draw(each).getImageData(0, 0, width, height));
  const quality = measureQuality(one, other);
  for (let i = 0; i < one.data.length; i++) if (i % 4 < 3) one.data[i] = DIFFERENCE * Math.abs(one.data[i] - other.data[i]);
  draw(difference).putImageData(one, 0, 0);
  return { picture, difference, quality };
}
