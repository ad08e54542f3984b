// @ts-check
/**
 * Measures how close a picture is to the truth, as `ciir demo` does (`service/demo/scores.py`; a test compares the two): on luma of
 * ITU-R BT.601 from 16 to 235 inside a border, with the mean similarity of Wang et al. 2004, equation 13, over windows of 11x11.
 */
const BORDER = 2; // pixels that are cut on each side
const PEAK = 255;
const RADIUS = 5, SIGMA = 1.5; // of the window, in pixels
const STABLE = [(0.01 * PEAK) ** 2, (0.03 * PEAK) ** 2];
const GAUSSIAN = Array.from({ length: 2 * RADIUS + 1 }, (_, i) => Math.exp(-0.5 * ((i - RADIUS) / SIGMA) ** 2));
const SUM = GAUSSIAN.reduce((sum, each) => sum + each);

/**
 * Returns the PSNR in dB, infinite if both are equal, and the SSIM, which is NaN below 15 pixels along a side.
 * @param {ImageData} picture
 * @param {ImageData} truth A picture of the same size.
 */
export function measureQuality(picture, truth) {
  const [one, other] = [readLuma(picture), readLuma(truth)];
  const width = truth.width - 2 * BORDER;
  const multiply = (/** @type {Float64Array} */ a, /** @type {Float64Array} */ b) => a.map((each, i) => each * b[i]);
  const planes = [one, other, multiply(one, one), multiply(other, other), multiply(one, other)];
  const [x, y, xx, yy, xy] = planes.map((plane) => average(average(plane, width), one.length / width));
  const similarity = x.map((mean, i) => {
    const means = mean * y[i], squares = mean * mean + y[i] * y[i];
    return ((2 * means + STABLE[0]) * (2 * (xy[i] - means) + STABLE[1])) / ((squares + STABLE[0]) * (xx[i] + yy[i] - squares + STABLE[1]));
  });
  const error = findMean(one.map((each, i) => (each - other[i]) ** 2));
  return { psnr: 10 * Math.log10((PEAK * PEAK) / error), ssim: findMean(similarity) };
}

/** @param {Float64Array} values */
function findMean(values) {
  return values.reduce((sum, each) => sum + each, 0) / values.length;
}

/** @param {ImageData} picture */
function readLuma({ data, width, height }) {
  const luma = new Float64Array(Math.max(0, width - 2 * BORDER) * Math.max(0, height - 2 * BORDER));
  for (let y = BORDER, i = 0; y < height - BORDER; y++) {
    for (let x = BORDER; x < width - BORDER; x++, i++) {
      const at = 4 * (y * width + x);
      luma[i] = 16 + (65.481 * data[at] + 128.553 * data[at + 1] + 24.966 * data[at + 2]) / 255;
    }
  }
  return luma;
}

/**
 * Averages along rows with the window as weights, where it lies inside. The result is transposed, so that two calls average an area.
 * @param {Float64Array} plane
 * @param {number} width The width of a row.
 */
function average(plane, width) {
  const height = plane.length / width, inside = Math.max(0, width - 2 * RADIUS);
  const means = new Float64Array(inside * height);
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < inside; x++) {
      let sum = 0;
      for (let i = 0; i < GAUSSIAN.length; i++) sum += GAUSSIAN[i] * plane[y * width + x + i];
      means[x * height + y] = sum / SUM;
    }
  }
  return means;
}
