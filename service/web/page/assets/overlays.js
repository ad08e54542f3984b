// @ts-check
/** What is laid over a light field: its disparity in colours, and the epipolar plane image (EPI) of a row of pixels. */
import { PICTURE_TEXTS } from "./texts.js";

/** @import { Stage } from "./viewer/page.js" */

const LINE = 8; // pixels of the EPI's height for each view

/**
 * Adds two check boxes to a light field whose views are loaded.
 * @param {Stage} stage
 * @param {() => Promise<Blob>} requestDisparity Makes the disparity of the centre view as a picture in colours.
 */
export function addOverlays(stage, requestDisparity) {
  const { lightField, viewer } = stage;
  const picture = /** @type {HTMLElement} */ (stage.element.querySelector(".picture"));
  const disparity = new Image();
  disparity.className = "overlay";
  disparity.alt = PICTURE_TEXTS.disparityShown;
  const row = make("input", { type: "range", max: String(lightField.height - 1), value: String(lightField.height >> 1) });
  const label = make("label", { textContent: PICTURE_TEXTS.row });
  label.append(row);
  const epi = make("canvas", { className: "epi", width: lightField.width, height: lightField.cols * LINE, role: "img", ariaLabel: PICTURE_TEXTS.epiShown });
  const drawEpi = () => {
    const small = new OffscreenCanvas(lightField.width, lightField.cols);
    small.getContext("2d")?.putImageData(viewer.readEpi(Number(row.value)), 0, 0);
    const context = epi.getContext("2d");
    if (!context) return;
    context.imageSmoothingEnabled = false;
    context.drawImage(small, 0, 0, epi.width, epi.height);
  };
  row.addEventListener("input", drawEpi);
  const showDisparity = async (/** @type {HTMLInputElement} */ box) => {
    if (box.checked && !disparity.src) {
      stage.status.textContent = PICTURE_TEXTS.measuring;
      try {
        disparity.src = URL.createObjectURL(await requestDisparity());
        await disparity.decode();
        stage.status.textContent = PICTURE_TEXTS.disparityShown;
      } catch (error) {
        box.checked = false;
        stage.status.textContent = error instanceof Error ? error.message : String(error);
      }
    }
    if (box.checked) picture.append(disparity);
    else disparity.remove();
  };
  const showEpi = (/** @type {HTMLInputElement} */ box) => {
    if (!box.checked) return void (epi.remove(), label.remove());
    picture.after(label, epi);
    drawEpi();
  };
  stage.stopped.signal.addEventListener("abort", () => URL.revokeObjectURL(disparity.src));
  stage.status.before(makeCheckbox("disparity", PICTURE_TEXTS.disparity, showDisparity), makeCheckbox("epi", PICTURE_TEXTS.epi, showEpi));
}

/**
 * @param {string} name
 * @param {string} text
 * @param {(box: HTMLInputElement) => void} change
 */
function makeCheckbox(name, text, change) {
  const box = make("input", { type: "checkbox", name });
  box.addEventListener("change", () => change(box));
  const label = make("label", {});
  label.append(box, ` ${text}`);
  return label;
}

/**
 * @template {keyof HTMLElementTagNameMap} T
 * @param {T} tag
 * @param {Record<string, unknown>} properties
 */
function make(tag, properties) {
  const element = document.createElement(tag);
  Object.assign(element, properties);
  return element;
}
