// @ts-check
/** Shows a light field as it arrives in `format=tiles`: small views first, then rows of views from the middle outwards. */
import { isEnded } from "../job/client.js";
import { PICTURE_TEXTS } from "../texts.js";
import { Stage } from "../viewer/page.js";

/** @typedef {import("../viewer/viewer.js").LightField} LightField */
/** @typedef {import("../viewer/viewer.js").Tile} Tile */

const MEMBER = 0x04034b50, DIRECTORY = 0x02014b50; // of a zip (APPNOTE.TXT 6.3.10, sections 4.3.7 and 4.3.12)
const HEADER = 30; // bytes of a member before its name
/** The settings in the address that determine how a light field is seen. */
export const PLACE = ["v", "u", "focus", "aperture"];
/** @type {WeakMap<HTMLElement, Stage>} The stage in each element. */
const shown = new WeakMap();

/**
 * Shows a light field in an element while its tiles arrive, in place of the previous content. The viewpoint in the address is kept
 * unless the previous light field had another size. A light field of the same size reuses the viewer.
 * @param {HTMLElement} element
 * @param {Response} response
 * @param {object} options
 * @param {number} [options.scale] By what factor these views are enlarged, until the larger ones follow.
 * @param {AbortSignal} [options.signal] Ends the loading.
 * @param {(stage: Stage) => void} [options.place] Called with a new viewer when it has something to show; the caller closes it.
 * @returns {Promise<Stage>} Resolves when all views are loaded.
 * @throws {Error} If the response is not a light field, WebGL 2 is missing, or the connection breaks.
 */
export async function showLightField(element, response, { scale = 1, signal, place } = {}) {
  const previous = shown.get(element);
  /** @type {Stage | undefined} */
  let stage;
  /** @type {Tile[]} */
  let tiles = [];
  try {
    for await (const { name, bytes } of readMembers(response)) {
      signal?.throwIfAborted();
      const tile = tiles.find(({ file }) => file === name);
      if (name === "light_field.json") {
        const { depth_sense: depthSense, tiles: planned, width, height, scale: made = 1, ...grid } = JSON.parse(new TextDecoder().decode(bytes));
        tiles = planned;
        const size = { ...grid, width: scale * width, height: scale * height, scale: scale * made };
        if (previous && !previous.stopped.signal.aborted && hasSize(previous.lightField, size)) {
          stage = previous;
          continue;
        }
        previous?.close();
        if (previous && !hasSize(previous.lightField, size)) forgetPlace();
        stage = new Stage(element, { ...size, depthSense });
        shown.set(element, stage);
      } else if (stage && tile) {
        const mosaic = await createImageBitmap(new Blob([bytes], { type: "image/jpeg" }));
        await stage.viewer.setTile(tile, mosaic);
        mosaic.close();
        signal?.throwIfAborted();
        if (!stage.hasBegun) {
          stage.begin();
          place?.(stage);
        } else stage.show();
      }
    }
    if (!stage?.hasBegun) throw new Error(PICTURE_TEXTS.noLightField);
    return stage;
  } catch (error) {
    if (!stage?.hasBegun) stage?.close();
    throw error;
  }
}

/**
 * Yields the stored members of a zip as they arrive.
 * @param {Response} response
 */
async function* readMembers(response) {
  if (!response.body) return;
  const reader = response.body.getReader();
  const take = readExactly(reader);
  for (;;) {
    const header = new DataView((await take(HEADER)).buffer);
    if (header.getUint32(0, true) === DIRECTORY) break;
    const isPlain = header.getUint32(0, true) === MEMBER && header.getUint16(8, true) === 0 && !(header.getUint16(6, true) & 8);
    if (!isPlain) throw new Error(PICTURE_TEXTS.noLightField);
    const name = new TextDecoder().decode(await take(header.getUint16(26, true)));
    await take(header.getUint16(28, true));
    yield { name, bytes: await take(header.getUint32(18, true)) };
  }
  await reader.cancel();
}

/**
 * Returns a function that reads the next `count` bytes.
 * @param {ReadableStreamDefaultReader<Uint8Array>} reader
 */
function readExactly(reader) {
  let left = new Uint8Array();
  return async (/** @type {number} */ count) => {
    const bytes = new Uint8Array(count);
    for (let filled = 0; filled < count; ) {
      if (left.length === 0) {
        const { done, value } = await reader.read().catch((error) => {
          throw isEnded(error) ? error : new Error(PICTURE_TEXTS.broken);
        });
        if (done) throw new Error(PICTURE_TEXTS.broken);
        left = new Uint8Array(value);
      }
      const some = left.subarray(0, count - filled);
      bytes.set(some, filled);
      filled += some.length;
      left = left.subarray(some.length);
    }
    return bytes;
  };
}

/**
 * @param {LightField} one
 * @param {LightField} other
 */
function hasSize(one, other) {
  return one.rows === other.rows && one.cols === other.cols && one.width === other.width && one.height === other.height;
}

/** Removes the viewpoint from the address. */
function forgetPlace() {
  const settings = new URLSearchParams(location.hash.slice(1));
  for (const name of PLACE) settings.delete(name);
  history.replaceState(null, "", `#${settings}`);
}
