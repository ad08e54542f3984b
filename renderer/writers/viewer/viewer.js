// @ts-check
/**
 * Shows a light field from any place between its views, in focus at any depth (WebGL 2).
 *
 * A picture from viewpoint (v, u), which need not be whole, is the mean of the views within `aperture` of it, each shifted by
 * `disparity` pixels for every view between them (shift and sum: Ng et al. 2005, "Light field photography with a hand-held
 * plenoptic camera", section 4). A point of that disparity is sharp. With the aperture 0 the nearest two to four views are blended.
 */

/**
 * @typedef {object} LightField
 * @property {number} rows Rows of views.
 * @property {number} cols Columns of views.
 * @property {number} width Of a view, in pixels.
 * @property {number} height
 * @property {"lenses" | "cameras"} depthSense Whether what is farther (lenses) or nearer (cameras) moves further to the left in the
 *   next view on the right.
 * @property {string[]} views Addresses of the pictures, row by row.
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
        vec3 sampled = texture(views, vec3(place - disparity * away, float(v * grid.x + u))).rgb;
        sum += weight * vec4(sampled, 1.0);
      }
    }
  }
  color = vec4(sum.rgb / max(sum.a, 1e-6), 1.0);
}`;

const SMALL = 96; // pixels along a side of the views in which disparity is measured
const CLEAR = 0.5; // of 255: by how much the best disparity must fit better than half of all

/** Shows a light field on a canvas. Call `load`; then set `viewpoint`, `disparity` and `aperture`, and call `draw`. */
export class LightFieldViewer {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {LightField} lightField
   * @throws {Error} Without WebGL 2, or where the graphics processor holds fewer views.
   */
  constructor(canvas, lightField) {
    const gl = canvas.getContext("webgl2", { antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2; switch on hardware acceleration, or use a newer one.");
    const most = gl.getParameter(gl.MAX_ARRAY_TEXTURE_LAYERS);
    const { rows, cols, width, height } = lightField;
    if (rows * cols > most) throw new Error(`${rows * cols} views; this graphics processor holds ${most}. Write fewer views.`);
    this.canvas = canvas;
    this.lightField = lightField;
    this.gl = gl;
    /** Row and column, which need not be whole. @type {[number, number]} */
    this.viewpoint = [(rows - 1) / 2, (cols - 1) / 2];
    /** By how many pixels what is in focus moves to the left from one view to the next on the right. */
    this.disparity = 0;
    /** Radius of the views that are added up, in views. */
    this.aperture = 0;
    /** Brightness of each small view, for `measureDisparity`. @type {(Float32Array | undefined)[]} */
    this.small = new Array(rows * cols);
    canvas.width = width;
    canvas.height = height;
    this.uniforms = this.#compile();
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, gl.createTexture());
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, gl.RGBA8, width, height, rows * cols);
    for (const side of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, side, gl.CLAMP_TO_EDGE);
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, filter, gl.LINEAR);
  }

  /**
   * Loads all views, those around the centre first.
   * @param {(done: number, total: number) => void} [progress]
   */
  async load(progress = () => {}) {
    const { rows, cols, views } = this.lightField;
    const distance = (/** @type {number} */ index) =>
      Math.hypot(Math.floor(index / cols) - (rows - 1) / 2, (index % cols) - (cols - 1) / 2);
    const order = views.map((_, index) => index).sort((a, b) => distance(a) - distance(b));
    for (const [done, index] of order.entries()) {
      await this.#loadView(index);
      progress(done + 1, order.length);
    }
  }

  /** Draws the picture. @param {boolean} [isQuick] With a large aperture, whether some views are left out. */
  draw(isQuick = false) {
    const { gl, uniforms, lightField } = this;
    const most = Math.ceil((2 * this.aperture + 1) / 7);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.uniform2i(uniforms.grid, lightField.cols, lightField.rows);
    gl.uniform2f(uniforms.viewpoint, this.viewpoint[1], this.viewpoint[0]);
    gl.uniform2f(uniforms.disparity, this.disparity / lightField.width, this.disparity / lightField.height);
    gl.uniform1f(uniforms.aperture, this.aperture);
    gl.uniform1i(uniforms.stride, isQuick ? most : 1);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  }

  /**
   * Moves the viewpoint by rows and columns of views, within the grid.
   * @param {number} v
   * @param {number} u
   */
  move(v, u) {
    const { rows, cols } = this.lightField;
    this.viewpoint = [clamp(this.viewpoint[0] + v, 0, rows - 1), clamp(this.viewpoint[1] + u, 0, cols - 1)];
  }

  /**
   * The disparity at a place of the centre view, in pixels, or of the whole of it: the one at which the views around differ least.
   * @param {number} [x] 0 to 1 from the left.
   * @param {number} [y] 0 to 1 from the top.
   * @returns {number | null} null where nothing there tells disparities apart, or the views are not loaded.
   */
  measureDisparity(x, y) {
    const { rows, cols, width, height } = this.lightField;
    const v = (rows - 1) >> 1, u = (cols - 1) >> 1;
    const centre = this.small[v * cols + u];
    /** @type {{picture: Float32Array, v: number, u: number}[]} */
    const others = [];
    for (const [dv, du] of [[0, 1], [0, -1], [1, 0], [-1, 0], [0, 2], [2, 0]]) {
      const row = v + dv, col = u + du;
      const picture = row >= 0 && row < rows && col >= 0 && col < cols ? this.small[row * cols + col] : undefined;
      if (picture) others.push({ picture, v: dv, u: du });
    }
    if (!centre || others.length === 0) return null;
    const radius = x === undefined ? SMALL / 2 : 5;
    const left = Math.round((x ?? 0.5) * SMALL), top = Math.round((y ?? 0.5) * SMALL);
    const errors = [];
    for (let shift = -SMALL / 4; shift <= SMALL / 4; shift += 0.25) {
      const error = difference(centre, others, left, top, radius, [(shift * width) / height, shift]);
      errors.push({ disparity: (shift * width) / SMALL, error });
    }
    errors.sort((a, b) => a.error - b.error);
    const best = errors[0], usual = errors[errors.length >> 1];
    return usual.error - best.error < CLEAR ? null : best.disparity;
  }

  /** @returns {Record<string, WebGLUniformLocation | null>} */
  #compile() {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of /** @type {const} */ ([[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]])) {
      const shader = gl.createShader(kind);
      if (!shader) throw new Error("WebGL was lost; load the page again.");
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "");
    gl.useProgram(program);
    const names = ["grid", "viewpoint", "disparity", "aperture", "stride"];
    return Object.fromEntries(names.map((name) => [name, gl.getUniformLocation(program, name)]));
  }

  /** @param {number} index */
  async #loadView(index) {
    const { gl, lightField } = this;
    const picture = new Image();
    picture.src = lightField.views[index];
    await picture.decode();
    gl.texSubImage3D(
      gl.TEXTURE_2D_ARRAY, 0, 0, 0, index, lightField.width, lightField.height, 1, gl.RGBA, gl.UNSIGNED_BYTE, picture,
    );
    this.small[index] = shrink(picture);
  }
}

/**
 * The brightness of a picture that is scaled to SMALL x SMALL pixels.
 * @param {HTMLImageElement} picture
 */
function shrink(picture) {
  const canvas = new OffscreenCanvas(SMALL, SMALL);
  const context = canvas.getContext("2d");
  if (!context) throw new Error("The browser refused a canvas; close other pages and load this one again.");
  context.drawImage(picture, 0, 0, SMALL, SMALL);
  const { data } = context.getImageData(0, 0, SMALL, SMALL);
  return Float32Array.from({ length: SMALL * SMALL }, (_, i) => (data[4 * i] + 2 * data[4 * i + 1] + data[4 * i + 2]) / 4);
}

/**
 * The mean difference between the centre view and the others, shifted by `shift` for each view, in a square.
 * @param {Float32Array} centre
 * @param {{picture: Float32Array, v: number, u: number}[]} others
 * @param {number} left
 * @param {number} top
 * @param {number} radius
 * @param {[number, number]} shift Down and across.
 */
function difference(centre, others, left, top, radius, shift) {
  let sum = 0, count = 0;
  for (let y = Math.max(0, top - radius); y < Math.min(SMALL, top + radius + 1); y++) {
    for (let x = Math.max(0, left - radius); x < Math.min(SMALL, left + radius + 1); x++) {
      for (const other of others) {
        const across = x - shift[1] * other.u, down = y - shift[0] * other.v;
        if (across < 0 || down < 0 || across > SMALL - 1 || down > SMALL - 1) continue;
        sum += Math.abs(centre[y * SMALL + x] - interpolate(other.picture, across, down));
        count++;
      }
    }
  }
  return count > 0 ? sum / count : Infinity;
}

/**
 * @param {Float32Array} picture
 * @param {number} x
 * @param {number} y
 */
function interpolate(picture, x, y) {
  const left = Math.min(Math.floor(x), SMALL - 2), top = Math.min(Math.floor(y), SMALL - 2);
  const at = top * SMALL + left, across = x - left, down = y - top;
  const upper = picture[at] * (1 - across) + picture[at + 1] * across;
  const lower = picture[at + SMALL] * (1 - across) + picture[at + SMALL + 1] * across;
  return upper * (1 - down) + lower * down;
}

/**
 * @param {number} value
 * @param {number} low
 * @param {number} high
 */
function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}
