// @ts-check
/** Overlays of a light field: its disparity in colours, and the epipolar plane image (EPI) of a row of pixels. */
import { make } from "../dom.js";
import { describeError } from "../job/client.js";
import { PICTURE_TEXTS } from "../texts.js";

/** @typedef {import("../viewer/page.js").Stage} Stage */

/**
 * Adds two check boxes to a light field whose views are loaded.
 * @param {Stage} stage
 * @param {() => Promise<Blob>} requestDisparity Makes a picture of the centre view's disparity in colours.
 */
export function addOverlays(stage, requestDisparity) {
  const picture = /** @type {HTMLElement} */ (stage.element.querySelector(".picture"));
  const disparity = make("img", "", { class: "overlay", alt: PICTURE_TEXTS.disparityShown });
  stage.stopped.signal.addEventListener("abort", () => URL.revokeObjectURL(disparity.src));
  const showDisparity = async (/** @type {HTMLInputElement} */ box) => {
    if (box.checked && !disparity.src) {
      stage.status.textContent = PICTURE_TEXTS.measuring;
      try {
        disparity.src = URL.createObjectURL(await requestDisparity());
        await disparity.decode();
        stage.status.textContent = PICTURE_TEXTS.disparityShown;
      } catch (error) {
        box.checked = false;
        stage.status.textContent = describeError(error);
      }
    }
    if (!box.checked) return disparity.remove();
    stage.tour.checked = false;
    stage.moveFromCentre(0, 0); // the disparity is that of the centre view
    picture.append(disparity);
  };
  const epi = makeEpi(stage, picture);
  const showEpi = (/** @type {HTMLInputElement} */ box) => (box.checked ? epi.show() : epi.hide());
  stage.status.before(makeCheckbox("disparity", PICTURE_TEXTS.disparity, showDisparity), makeCheckbox("epi", PICTURE_TEXTS.epi, showEpi));
}

/**
 * Makes the EPI of a row of pixels, which a slider or a click on the picture selects, and a line over the picture that marks the row.
 * @param {Stage} stage
 * @param {HTMLElement} picture
 */
function makeEpi(stage, picture) {
  const { canvas, lightField, viewer } = stage;
  const row = make("input", "", { name: "row", type: "range", max: String(lightField.height - 1), value: String(lightField.height >> 1) });
  const label = make("label", [make("span", PICTURE_TEXTS.row), row]);
  const epi = make("canvas", "", { class: "epi", role: "img", "aria-label": PICTURE_TEXTS.epiShown });
  const mark = make("div", "", { class: "mark" });
  const draw = () => {
    const pixels = viewer.readEpi((Number(row.value) + 0.5) / lightField.height);
    Object.assign(epi, { width: pixels.width, height: pixels.height });
    epi.style.setProperty("--views", String(pixels.height));
    epi.getContext("2d")?.putImageData(pixels, 0, 0);
    mark.style.setProperty("--row", String((Number(row.value) + 0.5) / lightField.height));
  };
  const choose = (/** @type {Event} */ event) => {
    row.value = String(Math.floor(/** @type {CustomEvent} */ (event).detail.y * lightField.height));
    draw();
  };
  row.addEventListener("input", draw);
  return {
    show: () => {
      picture.append(mark);
      picture.after(epi, label);
      canvas.addEventListener("choose", choose);
      draw();
    },
    hide: () => {
      for (const element of [mark, epi, label]) element.remove();
      canvas.removeEventListener("choose", choose);
    },
  };
}

/**
 * @param {string} name
 * @param {string} text
 * @param {(box: HTMLInputElement) => void} change
 */
function makeCheckbox(name, text, change) {
  const box = make("input", "", { type: "checkbox", name });
  box.addEventListener("change", () => change(box));
  return make("label", [box, make("span", text)]);
}
