// @ts-check
/** A mesh as the centre view shows it, drawn by three.js in the browser and placed as in `renderer/framing.py`. */
import {
  AmbientLight, DirectionalLight, DoubleSide, Group, LoadingManager, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  MeshPhongMaterial, OrthographicCamera, Scene, Triangle, Vector3, WebGLRenderer,
} from "three";

const FILL = 0.94, CLEARANCE = 0.05; // shares, of `renderer/framing.py`
const TANGENT_RANGE = 0.4; // over an elemental image, of `renderer/lens_array.py`
const AMBIENT = 0.3 * Math.PI, DIFFUSE = 0.7 * Math.PI; // about 0.6 and 0.4 of `renderer/shading.py`, in linear light
const LIGHT = [-0.4, 0.6, 0.7];
const GREY = 0xcccccc;
const MOST_POINTS = 200_000; // that decide the size: if triangles have more corners, some are left out
const ZERO_AREA = 1e-12; // times the longest edge squared, of `renderer/surface.py`
const MOST_PIXELS = 1024; // along a side
/** Extensions of glTF that three.js shows differently from the server. */
const UNLIKE = ["EXT_texture_avif", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_transmission", "KHR_node_visibility"];

/** @typedef {{name: string, file: File}} Named */
/** @typedef {{rows: number, cols: number, v: number, u: number, up: string, rotate: number[], zoom: number, place: number, depthFactor: number}} Stand */

/** @type {Record<string, (manager: any, data: ArrayBuffer) => Promise<any>>} Readers by suffix. */
const READERS = {
  glb: readGltf,
  vrm: readGltf,
  gltf: readGltf,
  async obj(manager, data) {
    const { OBJLoader } = await import("three/addons/loaders/OBJLoader.js");
    return new OBJLoader(manager).parse(new TextDecoder().decode(data));
  },
  async ply(manager, data) {
    const { PLYLoader } = await import("three/addons/loaders/PLYLoader.js");
    return makeMesh(new PLYLoader(manager).parse(data));
  },
  async stl(manager, data) {
    const { STLLoader } = await import("three/addons/loaders/STLLoader.js");
    return makeMesh(new STLLoader(manager).parse(data));
  },
};

/**
 * @param {any} manager
 * @param {ArrayBuffer} data
 */
async function readGltf(manager, data) {
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const { scene, parser } = await new GLTFLoader(manager).parseAsync(data, "");
  if (UNLIKE.some((name) => parser.json.extensionsUsed?.includes(name))) throw new Error();
  return scene;
}

/** @param {any} geometry */
function makeMesh(geometry) {
  return new Mesh(geometry, new MeshPhongMaterial({ vertexColors: geometry.hasAttribute("color") }));
}

/** A mesh on a canvas. */
export class Preview {
  /**
   * @param {HTMLCanvasElement} canvas
   * @throws {Error} If WebGL 2 is missing.
   */
  constructor(canvas) {
    const context = canvas.getContext("webgl2", { antialias: true });
    if (!context) throw new Error();
    this.renderer = new WebGLRenderer({ canvas, context });
    this.scene = new Scene();
    const light = new DirectionalLight(0xffffff, DIFFUSE);
    light.position.set(...LIGHT);
    this.holder = new Group();
    this.holder.matrixAutoUpdate = false;
    this.scene.add(new AmbientLight(0xffffff, AMBIENT), light, this.holder);
    this.points = new Float32Array();
  }

  /**
   * Reads a mesh.
   * @param {Named[]} files The mesh, and the files that it names.
   * @throws {Error} If three.js can't read the mesh, or would show it differently from the server.
   */
  async open(files) {
    const suffixes = files.map(({ name }) => name.toLowerCase().split(".").at(-1) ?? "");
    const main = suffixes.findIndex((suffix) => suffix in READERS);
    if (main < 0) throw new Error();
    const manager = new LoadingManager();
    /** @type {Map<string, string>} */
    const addresses = new Map(files.map(({ name, file }) => [name, URL.createObjectURL(file)]));
    manager.setURLModifier((/** @type {string} */ url) =>
      /^(blob|data):/.test(url) ? url : (addresses.get(findFile([...addresses.keys()], url, files[main].name) ?? "") ?? "data:,"),
    );
    try {
      const object = await READERS[suffixes[main]](manager, await files[main].file.arrayBuffer());
      this.points = collectPoints(prepare(object));
      if (this.points.length === 0) throw new Error();
      this.holder.add(object);
    } finally {
      for (const address of addresses.values()) URL.revokeObjectURL(address);
    }
  }

  /** @param {string} colour The background, such as `ffffff`. */
  fill(colour) {
    this.renderer.setClearColor(`#${colour}`);
  }

  /** @param {Stand} stand The place of the mesh in front of the lens array. */
  draw(stand) {
    const { rows, cols } = stand;
    const { matrix, near, far } = frame(this.points, stand);
    this.holder.matrix.copy(matrix);
    this.holder.matrixWorldNeedsUpdate = true;
    const camera = new OrthographicCamera(-cols / 2, cols / 2, rows / 2, -rows / 2, near, far);
    const scale = MOST_PIXELS / Math.max(rows, cols);
    this.renderer.setSize(Math.max(1, Math.round(cols * scale)), Math.max(1, Math.round(rows * scale)), false);
    this.renderer.render(this.scene, camera);
  }

  /** Ends the preview and frees what it holds on the graphics processor. */
  close() {
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}

/**
 * Finds the file that a mesh names, like `Resolver.find` of `renderer/readers/meshes/texture_files.py`.
 * @param {string[]} names The names of all files, with their paths.
 * @param {string} url
 * @param {string} main The mesh.
 */
function findFile(names, url, main) {
  const path = decodeURIComponent(url).replaceAll("\\", "/"), folder = main.slice(0, main.lastIndexOf("/") + 1);
  const whole = new URL((folder + path).split("/").map(encodeURIComponent).join("/"), "file:///").pathname; // without . and ..
  const getOwn = (/** @type {string} */ name) => name.slice(name.lastIndexOf("/") + 1);
  const alike = names.filter((name) => getOwn(name).toLowerCase() === getOwn(path).toLowerCase());
  const likely = [decodeURIComponent(whole).slice(1), folder + getOwn(path), ...(alike.length === 1 ? alike : [])];
  return likely.find((name) => names.includes(name));
}

/**
 * Gives an object the server's light, and hides points and lines.
 * @param {any} object
 * @returns {any[]} Its meshes.
 * @throws {Error} If a mesh is instanced, as only the server places the copies, or if `light` refuses a material.
 */
function prepare(object) {
  /** @type {any[]} */
  const meshes = [];
  object.updateMatrixWorld(true);
  object.traverse((/** @type {any} */ node) => {
    if (node.isInstancedMesh) throw new Error();
    if (node.isPoints || node.isLine) node.visible = false;
    if (!node.isMesh) return;
    if (!node.geometry.hasAttribute("normal")) node.geometry.computeVertexNormals();
    node.material = Array.isArray(node.material) ? node.material.map(light) : light(node.material);
    node.frustumCulled = false;
    meshes.push(node);
  });
  return meshes;
}

/**
 * Makes a material with the server's light.
 * @param {any} material A standard or basic material for a glTF file, otherwise Phong, which is grey without colours.
 * @throws {Error} If a texture is scaled unevenly and rotated, as three.js rotates it first.
 */
function light(material) {
  const { isMeshPhongMaterial, isMeshBasicMaterial, flatShading, emissive = [], emissiveMap, transparent, opacity, alphaTest } = material;
  let { map, color, vertexColors } = material;
  if (isMeshPhongMaterial && !vertexColors) color.set(GREY);
  const isBlack = [...color].every((value) => value === 0), emits = [...emissive].some((value) => value > 0);
  const onlyEmits = isBlack && emits && !transparent && !alphaTest; // as in `renderer/readers/meshes/gltf/materials.py`
  if (onlyEmits) [map, color, vertexColors] = [emissiveMap, emissive, false];
  if (map?.rotation && map.repeat.x !== map.repeat.y) throw new Error();
  const given = { map, color, vertexColors, transparent, opacity, alphaTest, side: DoubleSide };
  return isMeshBasicMaterial || onlyEmits ? new MeshBasicMaterial(given) : new MeshLambertMaterial({ ...given, flatShading });
}

/**
 * Returns the corners of triangles that have an area, in the object's coordinates: x, y and z one after the other.
 * @param {any[]} meshes
 */
function collectPoints(meshes) {
  const sizes = meshes.map(({ geometry }) => (geometry.index ?? geometry.attributes.position).count);
  const step = 3 * Math.ceil(sizes.reduce((sum, size) => sum + size, 0) / MOST_POINTS);
  /** @type {number[]} */
  const points = [];
  const triangle = new Triangle(), { a, b, c } = triangle;
  for (const [number, mesh] of meshes.entries()) {
    const { index } = mesh.geometry;
    for (let place = 0; place + 2 < sizes[number]; place += step) {
      for (const [corner, point] of [a, b, c].entries()) {
        mesh.getVertexPosition(index ? index.getX(place + corner) : place + corner, point).applyMatrix4(mesh.matrixWorld);
      }
      const longest = Math.max(a.distanceToSquared(b), b.distanceToSquared(c), c.distanceToSquared(a));
      if (2 * triangle.getArea() > ZERO_AREA * longest) points.push(...a, ...b, ...c);
    }
  }
  return Float32Array.from(points);
}

/**
 * Places the object in the lens array's coordinates, like `frame_scene` of `renderer/framing.py`.
 * @param {Float32Array} points
 * @param {Stand} stand
 */
function frame(points, { rows, cols, v, u, up, rotate, zoom, place, depthFactor }) {
  const [yaw, pitch, roll] = rotate.map((degrees) => (degrees * Math.PI) / 180);
  const turn = new Matrix4().makeRotationZ(roll);
  turn.multiply(new Matrix4().makeRotationX(pitch)).multiply(new Matrix4().makeRotationY(yaw));
  if (up === "z") turn.multiply(new Matrix4().makeRotationX(-Math.PI / 2));
  const turned = new Float32Array(points.length), point = new Vector3();
  const low = new Vector3(Infinity, Infinity, Infinity), high = low.clone().negate();
  for (let i = 0; i < points.length; i += 3) {
    point.fromArray(points, i).applyMatrix4(turn).toArray(turned, i);
    low.min(point);
    high.max(point);
  }
  const middle = low.clone().add(high).divideScalar(2), sides = high.clone().sub(low);
  const gap = CLEARANCE * Math.max(sides.x, sides.y, sides.z);
  const plane = ((high.z + gap) * (1 - place)) / 2 + ((low.z - gap) * (1 + place)) / 2;
  const delta = TANGENT_RANGE / Math.max(v, u);
  const reachX = ((u - 1) / 2) * delta, reachY = ((v - 1) / 2) * delta;
  let sweptX = 0, sweptY = 0;
  for (let i = 0; i < turned.length; i += 3) {
    const distance = Math.abs(plane - turned[i + 2]);
    sweptX = Math.max(sweptX, Math.abs(turned[i] - middle.x) + reachX * distance);
    sweptY = Math.max(sweptY, Math.abs(turned[i + 1] - middle.y) + reachY * distance);
  }
  const scale = ((zoom * FILL) / 2) * Math.min(cols / sweptX, rows / sweptY);
  const deep = scale * depthFactor;
  const tx = (Math.floor(u / 2) - (u - 1) / 2) * delta, ty = ((v - 1) / 2 - Math.floor(v / 2)) * delta; // of the centre view
  const matrix = new Matrix4();
  matrix.elements[8] = tx;
  matrix.elements[9] = ty;
  matrix.multiply(new Matrix4().makeScale(scale, scale, deep));
  matrix.multiply(new Matrix4().makeTranslation(-middle.x, -middle.y, -plane)).multiply(turn);
  return { matrix, near: deep * (plane - high.z - gap), far: deep * (plane - low.z + gap) };
}
