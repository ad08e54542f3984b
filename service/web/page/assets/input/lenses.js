// @ts-check
/** The places of lenses in a picture: whole elemental images, or any lens grid of a raw picture. */

const ROW_STEP = Math.sqrt(3) / 2; // between rows of a hexagonal grid, in pitches
/** Offsets count from the centre of a pixel, places from its corner. */
export const HALF = 0.5;

/**
 * Places in a picture are [y, x] in pixels from its upper left corner.
 * @typedef {[number, number]} Place
 */
/** @typedef {{pitch: number, offset: Place, rotation: number, shape: string, stretch?: number}} RawGrid The lens grid of a raw picture. */
/** @typedef {{size: Place, isMosaic?: boolean}} Cells Elemental images, or views of a mosaic, by their size. */

/** @param {RawGrid | Cells} grid @returns {grid is RawGrid} */
export function isRaw(grid) {
  return "pitch" in grid;
}

/** @param {RawGrid | Cells} grid @returns {Place} */
export function sizeOf(grid) {
  return isRaw(grid) ? [grid.pitch, grid.pitch] : grid.size;
}

/**
 * Returns the step from row to row and the shift of every other row, in pitches, and whether rows are columns.
 * @param {RawGrid} grid
 */
export function readShape({ shape, stretch = 1 }) {
  return { rowStep: shape === "square" ? stretch : ROW_STEP * stretch, shift: shape === "square" ? 0 : 0.5, isTransposed: shape === "hexagonal-columns" };
}

/**
 * Returns the centre of a lens, like `find_centers` of `renderer/readers/lenslet/grid.py`.
 * @param {RawGrid} grid
 * @param {Place} lens
 * @returns {Place}
 */
export function findCentre(grid, [row, column]) {
  const { rowStep, shift, isTransposed } = readShape(grid);
  const steps = [row * rowStep * grid.pitch, (column + (Math.abs(row) % 2) * shift) * grid.pitch];
  const [down, right] = isTransposed ? steps.reverse() : steps;
  const angle = (grid.rotation * Math.PI) / 180;
  return [
    grid.offset[0] + HALF + down * Math.cos(angle) + right * Math.sin(angle),
    grid.offset[1] + HALF + right * Math.cos(angle) - down * Math.sin(angle),
  ];
}

/**
 * Returns the lens near a place.
 * @param {RawGrid} grid
 * @param {Place} place
 * @returns {Place}
 */
export function findLens(grid, place) {
  const { rowStep, shift, isTransposed } = readShape(grid);
  const angle = (grid.rotation * Math.PI) / 180, y = place[0] - HALF - grid.offset[0], x = place[1] - HALF - grid.offset[1];
  const steps = [y * Math.cos(angle) - x * Math.sin(angle), x * Math.cos(angle) + y * Math.sin(angle)];
  const [across, along] = isTransposed ? steps.reverse() : steps;
  const row = Math.round(across / grid.pitch / rowStep);
  return [row, Math.round(along / grid.pitch - (Math.abs(row) % 2) * shift)];
}

/** @param {number} size */
export function listDivisors(size) {
  return Array.from({ length: size }, (_, index) => index + 1).filter((each) => size % each === 0);
}

/** @param {number[]} sizes @param {number} wanted */
export function findNearest(sizes, wanted) {
  return sizes.reduce((best, each) => (Math.abs(each - wanted) < Math.abs(best - wanted) ? each : best));
}

/**
 * Returns the grid that the settings give.
 * @param {Record<string, string>} settings
 * @param {Place} size The size of the picture.
 * @returns {RawGrid | Cells | undefined} undefined if the grid has to be found in the picture.
 */
export function readGrid(settings, size) {
  const { pixels = "", lenses = "", lens_pitch: pitch, lens_offset: offset, lens_rotation: rotation, lens_grid: shape, arrangement } = settings;
  if (pitch) {
    const [y, x] = (offset ?? "").split(",").map(Number);
    const isWhole = Number(pitch) > 0 && offset && rotation && shape && shape !== "auto";
    return isWhole ? { pitch: Number(pitch), offset: [y, x], rotation: Number(rotation), shape } : undefined;
  }
  const isMosaic = arrangement === "mosaic";
  const counts = readPair(isMosaic ? pixels : lenses), sides = readPair(isMosaic ? lenses : pixels);
  if (counts) return { isMosaic, size: [size[0] / counts[0], size[1] / counts[1]] };
  return sides && { isMosaic, size: sides };
}

/** @param {string} text @returns {Place | undefined} */
function readPair(text) {
  const found = /^([1-9]\d{0,5})\s*x\s*([1-9]\d{0,5})$/.exec(text);
  return found ? [Number(found[1]), Number(found[2])] : undefined;
}
