// @ts-check
/**
 * Shows a light field from any place between its views, in focus at any depth (WebGL 2).
 *
 * A picture from viewpoint (v, u), which need not be whole, is the mean of the views within `aperture` of it, each shifted by
 * `disparity` pixels for every view between them (shift and sum: Ng et al. 2005, "Light field photography with a hand-held
 * plenoptic camera", section 4). A point of that disparity is sharp. With the aperture 0 the nearest two to four views are blended.
 */
import { DisparityMeter } from "./disparity.js";
import { VIEWER_TEXTS } from "./texts.js";

/**
 * @typedef {object} LightField
 * @property {number} rows Rows of views.
 * @property {number} cols Columns of views.
 * @property {number} width Of a view, in pixels.
 * @property {number} height
 * @property {number} scale Pixels for each pixel of the views that were read, along each side.
 * @property {"lenses" | "cameras"} depthSense Whether what is farther (lenses) or nearer (cameras) moves further to the left in the
 *   next view on the right.
 */

/**
 * @typedef {object} Tile A mosaic: view (v, u) of `rows` rows of views from `row` on begins at pixel ((v - row) * cell_height, u * cell_width).
 * @property {string} file
 * @property {number} row
 * @property {number} rows
 * @property {number} height Of a view in it.
 * @property {number} width
 * @property {number} cell_height
 * @property {number} cell_width
 */

/**
 * @typedef {object} Level Views of one size in a texture, whole rows of them.
 * @property {number} width
 * @property {number} height
 * @property {number} unit
 * @property {WebGLTexture} texture
 * @property {number} first The first row of views that is loaded, and the last; rows between them are.
 * @property {number} last
 */

const VERTEX = `#version 300 es
out vec2 place;  // (0, 0) at the top left of the picture, (1, 1) at its lower right
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  place = vec2(corner.x, 1.0 - corner.y);
  gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}`;

const MOST_TAPS = 1024; // vectors that a uniform block holds everywhere
const HEAD = `#version 300 es
precision highp float;
precision highp sampler2DArray;
uniform sampler2DArray views;
in vec2 place;
out vec4 color;`;
// taps: of each view what its picture is shifted by, its layer, its weight
const MANY = `${HEAD}
uniform int count;
layout(std140) uniform Taps { vec4 taps[${MOST_TAPS}]; };
void main() {
  vec3 sum = vec3(0.0);
  for (int i = 0; i < count; i++) sum += taps[i].w * textureLod(views, vec3(place - taps[i].xy, taps[i].z), 0.0).rgb;
  color = vec4(sum, 1.0);
}`;
const SLOW = 20; // milliseconds of a frame, above which less is drawn while something moves
const FEW = 4; // views that are always added up, and without a loop, which takes twice as long in software

/** Shows a light field on a canvas. Load the views with `setView` or `setTile`; set `viewpoint`, `disparity` and `aperture`; call `draw`. */
export class LightFieldViewer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {LightField} lightField
   * @throws {Error} Without WebGL 2, or where the graphics processor holds fewer views.
   */
  constructor(canvas, lightField) {
    const gl = canvas.getContext("webgl2", { antialias: false, alpha: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error(VIEWER_TEXTS.noWebgl);
    const most = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    const { rows, cols } = lightField;
    if (rows * cols > most) throw new Error(VIEWER_TEXTS.tooMany(rows * cols, most));
    this.canvas = canvas;
    this.lightField = lightField;
    this.gl = gl;
    /** @type {[number, number]} Row and column, which need not be whole. */
    this.viewpoint = [(rows - 1) / 2, (cols - 1) / 2];
    /** By how many pixels what is in focus moves to the left from one view to the next on the right. */
    this.disparity = 0;
    /** Radius of the views that are added up, in views. */
    this.aperture = 0;
    /** Views that are added up while something moves; below FEW the picture has half the pixels along a side. */
    this.most = 64;
    this.meter = new DisparityMeter(lightField);
    /** @type {Level[]} The smallest views first, which stand for larger ones that are not loaded. */
    this.levels = [];
    this.programs = Array.from({ length: FEW + 1 }, (_, count) => this.#compile(count ? addUp(count) : MANY));
    gl.bindBufferBase(gl.UNIFORM_BUFFER, 0, gl.createBuffer());
    gl.bufferData(gl.UNIFORM_BUFFER, 16 * MOST_TAPS, gl.DYNAMIC_DRAW);
  }

  /**
   * Loads a mosaic of views. Small views stand for those that are not there yet; rows of views come from the middle outwards.
   * @param {Tile} tile
   * @param {ImageBitmap} mosaic
   */
  async setTile(tile, mosaic) {
    const { rows, cols } = this.lightField;
    if (this.levels.some(({ width, first, last }) => width > tile.width && first === 0 && last === rows - 1)) return;
    for (let v = 0; v < tile.rows; v++) {
      for (let u = 0; u < cols; u++) {
        const view = await createImageBitmap(mosaic, u * tile.cell_width, v * tile.cell_height, tile.width, tile.height);
        this.setView((tile.row + v) * cols + u, view);
        view.close();
        await new Promise((done) => setTimeout(done)); // so that the page answers in between
      }
    }
  }

  /**
   * Loads a view of any size, after those to the left of it.
   * @param {number} index
   * @param {ImageBitmap | HTMLImageElement} picture
   */
  setView(index, picture) {
    const { gl, lightField } = this;
    const level = this.levels.find(({ width, height }) => width === picture.width && height === picture.height) ?? this.#addLevel(picture);
    gl.activeTexture(gl.TEXTURE0 + level.unit);
    gl.texSubImage3D(
      gl.TEXTURE_2D_ARRAY, 0, 0, 0, index, picture.width, picture.height, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture,
    );
    const row = Math.floor(index / lightField.cols);
    if ((index + 1) % lightField.cols === 0) Object.assign(level, { first: Math.min(row, level.first), last: Math.max(row, level.last) });
    if (this.meter.needs(index)) this.meter.add(index, picture);
  }

  /**
   * The epipolar plane image of a row of pixels, RGBA: the row in each view of the middle row of views, from left to right.
   * @param {number} place Of the row, 0 to 1 from the top.
   */
  readEpi(place) {
    const { gl, lightField } = this;
    const { rows, cols } = lightField;
    const middle = (rows - 1) >> 1;
    const { width, height, texture } = this.#findLevel(middle, middle);
    const pixels = new Uint8ClampedArray(cols * width * 4);
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    for (let col = 0; col < cols; col++) {
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, texture, 0, middle * cols + col);
      const y = Math.min(Math.floor(place * height), height - 1);
      gl.readPixels(0, y, width, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixels, col * width * 4);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(buffer);
    return new ImageData(pixels, width, cols);
  }

  /** Frees the memory of the graphics processor; the viewer can't be used any more. */
  close() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }

  /**
   * Draws the picture.
   * @param {boolean} [isQuick] Whether views and pixels are left out where frames take long.
   */
  draw(isQuick = false) {
    const { gl, lightField } = this;
    const most = isQuick ? Math.max(FEW, this.most) : MOST_TAPS;
    let taps = this.#findTaps(1);
    for (let stride = 2; taps.length > 4 * most && stride <= lightField.rows + lightField.cols; stride++) {
      taps = this.#findTaps(stride);
    }
    const detail = isQuick && this.most < FEW ? 0.5 : 1;
    const width = Math.ceil(lightField.width * detail), height = Math.ceil(lightField.height * detail);
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const rows = taps.filter((_, i) => i % 4 === 2).map((layer) => Math.floor(layer / lightField.cols));
    const count = taps.length / 4;
    const { program, uniforms } = this.programs[count > FEW ? 0 : count];
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.useProgram(program);
    gl.uniform1i(uniforms.views, this.#findLevel(Math.min(...rows), Math.max(...rows)).unit);
    if (count > FEW) {
      gl.uniform1i(uniforms.count, count);
      gl.bufferSubData(gl.UNIFORM_BUFFER, 0, new Float32Array(taps));
    } else gl.uniform4fv(uniforms.taps, taps);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /**
   * Fits the work of a quick picture to the time that the last one took.
   * @param {number} milliseconds
   */
  adapt(milliseconds) {
    this.most = milliseconds > SLOW ? Math.max(1, this.most * 0.7) : Math.min(MOST_TAPS, this.most * 1.02);
  }

  /**
   * The views around the viewpoint, four numbers each, as the shader has them.
   * @param {number} stride Of the views that are taken.
   */
  #findTaps(stride) {
    const { rows, cols, width, height } = this.lightField;
    const [v, u] = this.viewpoint;
    const reach = this.aperture + stride;
    const taps = [];
    for (let row = Math.max(0, Math.ceil(v - reach)); row <= Math.min(rows - 1, v + reach); row += stride) {
      for (let col = Math.max(0, Math.ceil(u - reach)); col <= Math.min(cols - 1, u + reach); col += stride) {
        const weight = clamp(reach - Math.hypot(row - v, col - u), 0, 1);
        const shift = [(this.disparity * (col - u)) / width, (this.disparity * (row - v)) / height];
        if (weight > 0) taps.push(...shift, row * cols + col, weight);
      }
    }
    const sum = taps.reduce((total, value, i) => (i % 4 === 3 ? total + value : total), 0);
    return taps.map((value, i) => (i % 4 === 3 ? value / sum : value));
  }

  /**
   * Moves the viewpoint to a place between the views.
   * @param {number} v
   * @param {number} u
   */
  moveTo(v, u) {
    const { rows, cols } = this.lightField;
    this.viewpoint = [clamp(v, 0, rows - 1), clamp(u, 0, cols - 1)];
  }

  /** @param {string} fragment */
  #compile(fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    if (!program) throw new Error(VIEWER_TEXTS.lostWebgl);
    for (const [kind, source] of /** @type {const} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]])) {
      const shader = gl.createShader(kind);
      if (!shader) throw new Error(VIEWER_TEXTS.lostWebgl);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "");
    const [views, count, taps] = ["views", "count", "taps"].map((name) => gl.getUniformLocation(program, name));
    return { program, uniforms: { views, count, taps } };
  }

  /**
   * The largest views of which these rows are loaded, else the smallest.
   * @param {number} first
   * @param {number} last
   */
  #findLevel(first, last) {
    return this.levels.filter((level) => level.first <= first && last <= level.last).at(-1) ?? this.levels[0];
  }

  /**
   * Makes a texture for all views.
   * @param {{width: number, height: number}} size Of a view.
   */
  #addLevel({ width, height }) {
    const { gl, lightField } = this;
    const texture = gl.createTexture();
    if (!texture) throw new Error(VIEWER_TEXTS.lostWebgl);
    const unit = this.levels.length;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, width, height, lightField.rows * lightField.cols);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, side, gl.CLAMP_TO_EDGE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, filter, gl.LINEAR);
    const level = { width, height, unit, texture, first: lightField.rows, last: -1 };
    this.levels = [...this.levels, level].sort((one, other) => one.width - other.width);
    return level;
  }
}

/**
 * A shader that adds up so many views.
 * @param {number} count
 */
function addUp(count) {
  const terms = Array.from({ length: count }, (_, i) => `taps[${i}].w * texture(views, vec3(place - taps[${i}].xy, taps[${i}].z))`);
  return `${HEAD}
uniform vec4 taps[${count}];
void main() { color = vec4((${terms.join(" + ")}).rgb, 1.0); }`;
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}
