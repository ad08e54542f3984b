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

const VERTEX = `#version 300 es
out vec2 place;  // (0, 0) at the top left of the picture, (1, 1) at its lower right
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  place = vec2(corner.x, 1.0 - corner.y);
  gl_Position = vec4(2.0 * corner - 1.0, 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DArray;
uniform sampler2DArray views;
uniform sampler2DArray coarse;
uniform ivec2 fine;       // first and last row of views that are loaded
uniform ivec2 grid;       // columns and rows of views
uniform vec2 viewpoint;   // u, v
uniform vec2 disparity;   // by which a view's picture moves to the left and up from one view to the next, as a share of its size
uniform float aperture;   // radius, in views
uniform int stride;       // of the views that are added up
in vec2 place;
out vec4 color;
void main() {
  ivec2 first = max(ivec2(ceil(viewpoint - aperture - 1.0)), 0);
  ivec2 last = min(ivec2(floor(viewpoint + aperture + 1.0)), grid - 1);
  vec4 sum = vec4(0.0);
  for (int v = first.y; v <= last.y; v += stride) {
    for (int u = first.x; u <= last.x; u += stride) {
      vec2 away = vec2(u, v) - viewpoint;
      float weight = clamp(float(stride) + aperture - length(away), 0.0, 1.0);
      if (weight > 0.0) {
        vec3 at = vec3(place - disparity * away, float(v * grid.x + u));
        vec3 sampled = v >= fine.x && v <= fine.y ? textureLod(views, at, 0.0).rgb : textureLod(coarse, at, 0.0).rgb;
        sum += weight * vec4(sampled, 1.0);
      }
    }
  }
  color = vec4(sum.rgb / max(sum.a, 1e-6), 1.0);
}`;

/** Shows a light field on a canvas. Load the views with `setView` or `setTile`; set `viewpoint`, `disparity` and `aperture`; call `draw`. */
export class LightFieldViewer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {LightField} lightField
   * @throws {Error} Without WebGL 2, or where the graphics processor holds fewer views.
   */
  constructor(canvas, lightField) {
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error(VIEWER_TEXTS.noWebgl);
    const most = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    const { rows, cols, width, height } = lightField;
    if (rows * cols > most) throw new Error(VIEWER_TEXTS.tooMany(rows * cols, most));
    this.canvas = canvas;
    this.lightField = lightField;
    this.gl = gl;
    /** Row and column, which need not be whole. @type {[number, number]} */
    this.viewpoint = [(rows - 1) / 2, (cols - 1) / 2];
    /** By how many pixels what is in focus moves to the left from one view to the next on the right. */
    this.disparity = 0;
    /** Radius of the views that are added up, in views. */
    this.aperture = 0;
    this.meter = new DisparityMeter(lightField);
    /** The first and the last row of views that are loaded; coarse views stand for the others. */
    this.fine = [0, rows - 1];
    canvas.width = width;
    canvas.height = height;
    this.uniforms = this.#compile();
    this.texture = this.#allocate(gl.TEXTURE0, width, height);
    gl.activeTexture(gl.TEXTURE1); // a sampler must have a texture, also where there are no coarse views
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, this.texture);
  }

  /**
   * Loads a mosaic of views. Small views stand for those that are not there yet; rows of views come from the middle outwards.
   * @param {Tile} tile
   * @param {ImageBitmap} mosaic
   */
  async setTile(tile, mosaic) {
    const { gl, lightField } = this;
    const isCoarse = tile.width < lightField.width || tile.height < lightField.height;
    if (isCoarse) this.#allocate(gl.TEXTURE1, tile.width, tile.height);
    for (let v = 0; v < tile.rows; v++) {
      for (let u = 0; u < lightField.cols; u++) {
        const view = await createImageBitmap(mosaic, u * tile.cell_width, v * tile.cell_height, tile.width, tile.height);
        this.setView((tile.row + v) * lightField.cols + u, view, isCoarse ? gl.TEXTURE1 : gl.TEXTURE0);
        view.close();
      }
    }
    const [first, last] = this.fine;
    this.fine = isCoarse ? [lightField.rows, -1] : [Math.min(tile.row, first), Math.max(tile.row + tile.rows - 1, last)];
  }

  /**
   * Loads a view.
   * @param {number} index
   * @param {ImageBitmap | HTMLImageElement} picture
   * @param {number} [unit] That of the views, or of the small ones.
   */
  setView(index, picture, unit = this.gl.TEXTURE0) {
    const { gl } = this;
    gl.activeTexture(unit);
    gl.texSubImage3D(
      gl.TEXTURE_2D_ARRAY, 0, 0, 0, index, picture.width, picture.height, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture,
    );
    if (this.meter.needs(index)) this.meter.add(index, picture);
  }

  /**
   * The epipolar plane image of a row of pixels, RGBA: the row in each view of the middle row of views, from left to right.
   * @param {number} y
   */
  readEpi(y) {
    const { gl, lightField } = this;
    const { rows, cols, width } = lightField;
    const pixels = new Uint8ClampedArray(cols * width * 4);
    const buffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
    for (let col = 0; col < cols; col++) {
      const layer = ((rows - 1) >> 1) * cols + col;
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, this.texture, 0, layer);
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

  /** Draws the picture. @param {boolean} [isQuick] With a large aperture, whether some views are left out. */
  draw(isQuick = false) {
    const { gl, uniforms, lightField } = this;
    const most = Math.ceil((2 * this.aperture + 1) / 7);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.uniform2i(uniforms.grid, lightField.cols, lightField.rows);
    gl.uniform2i(uniforms.fine, this.fine[0], this.fine[1]);
    gl.uniform1i(uniforms.coarse, 1);
    gl.uniform2f(uniforms.viewpoint, this.viewpoint[1], this.viewpoint[0]);
    gl.uniform2f(uniforms.disparity, this.disparity / lightField.width, this.disparity / lightField.height);
    gl.uniform1f(uniforms.aperture, this.aperture);
    gl.uniform1i(uniforms.stride, isQuick ? most : 1);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
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

  /** @returns {Record<string, WebGLUniformLocation | null>} */
  #compile() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of /** @type {const} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
      const shader = gl.createShader(kind);
      if (!shader) throw new Error(VIEWER_TEXTS.lostWebgl);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "");
    gl.useProgram(program);
    const names = ["grid", "coarse", "fine", "viewpoint", "disparity", "aperture", "stride"];
    return Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
  }

  /**
   * Makes a texture for all views and binds it.
   * @param {number} unit
   * @param {number} width
   * @param {number} height
   */
  #allocate(unit, width, height) {
    const { gl, lightField } = this;
    const texture = gl.createTexture();
    gl.activeTexture(unit);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, width, height, lightField.rows * lightField.cols);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, side, gl.CLAMP_TO_EDGE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, filter, gl.LINEAR);
    return texture;
  }
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}
