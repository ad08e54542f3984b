// @ts-check
/** A mesh as the centre view shows it, drawn by three.js in the browser: placed as `renderer/framing.py` does. */
import {
  AmbientLight, DirectionalLight, DoubleSide, Group, LoadingManager, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  MeshPhongMaterial, OrthographicCamera, Scene, Vector3, WebGLRenderer,
} from "three";

const FILL = 0.94, CLEARANCE = 0.05; // shares, of `renderer/framing.py`
const TANGENT_RANGE = 0.4; // over an elemental image, of `renderer/lens_array.py`
const AMBIENT = 0.3 * Math.PI, DIFFUSE = 0.7 * Math.PI; // about 0.6 and 0.4 of `renderer/shading.py`, in linear light
const LIGHT = [-0.4, 0.6, 0.7];
const GREY = 0xcccccc;
const MOST_POINTS = 200_000; // that decide the size: of more vertices, some are left out
const MOST_PIXELS = 1024; // along a side

/** @typedef {{name: string, file: File}} Named */
/** @typedef {{rows: number, cols: number, v: number, u: number, up: string, rotate: number[], zoom: number, place: number}} Stand */

/** @type {Record<string, (manager: any, data: ArrayBuffer) => Promise<any>>} By suffix. */
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
  return (await new GLTFLoader(manager).parseAsync(data, "")).scene;
}

/** @param {any} geometry */
function makeMesh(geometry) {
  return new Mesh(geometry, new MeshPhongMaterial({ vertexColors: geometry.hasAttribute("color") }));
}

/** A mesh on a canvas. */
export class Preview {
  /**
   * @param {HTMLCanvasElement} canvas
   * @throws {Error} Without WebGL 2.
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
   * @param {Named[]} files The mesh, and those that it names.
   * @throws {Error} For a mesh that three.js doesn't read, or that it would show otherwise than the server.
   */
  async open(files) {
    const suffixes = files.map(({ name }) => name.toLowerCase().split(".").at(-1) ?? "");
    const main = suffixes.findIndex((suffix) => suffix in READERS);
    if (main < 0) throw new Error();
    const manager = new LoadingManager();
    /** @type {Map<string, string>} */
    const addresses = new Map(files.map(({ name, file }) => [name.split("/").at(-1) ?? "", URL.createObjectURL(file)]));
    manager.setURLModifier((/** @type {string} */ url) =>
      /^(blob|data):/.test(url) ? url : (addresses.get(decodeURIComponent(url).split("/").at(-1) ?? "") ?? "data:,"),
    );
    try {
      const object = await READERS[suffixes[main]](manager, await files[main].file.arrayBuffer());
      const meshes = prepare(object);
      this.points = collectPoints(meshes);
      this.holder.add(object);
    } finally {
      for (const address of addresses.values()) URL.revokeObjectURL(address);
    }
  }

  /** @param {string} colour Behind the mesh, such as `ffffff`. */
  fill(colour) {
    this.renderer.setClearColor(`#${colour}`);
  }

  /** @param {Stand} stand Of the mesh before the lens array. */
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

  /** Ends it, and what it holds on the graphics processor. */
  close() {
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}

/**
 * Gives an object the server's light, and leaves out what is no triangle.
 * @param {any} object
 * @returns {any[]} Its meshes.
 * @throws {Error} Where there is none, or copies of one, which the server alone places.
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
  if (meshes.length === 0) throw new Error();
  return meshes;
}

/** @param {any} material Of a glTF file standard or basic, of others Phong: without colours they are grey. */
function light({ isMeshPhongMaterial, isMeshBasicMaterial, map, color, vertexColors, transparent, opacity, alphaTest, flatShading }) {
  if (isMeshPhongMaterial && !vertexColors) color.set(GREY);
  const given = { map, color, vertexColors, transparent, opacity, alphaTest, side: DoubleSide };
  return isMeshBasicMaterial ? new MeshBasicMaterial(given) : new MeshLambertMaterial({ ...given, flatShading });
}

/**
 * The vertices of triangles, in the object's coordinates, x, y and z one after the other.
 * @param {any[]} meshes
 */
function collectPoints(meshes) {
  const sizes = meshes.map(({ geometry }) => (geometry.index ?? geometry.attributes.position).count);
  const step = Math.ceil(sizes.reduce((sum, size) => sum + size, 0) / MOST_POINTS);
  /** @type {number[]} */
  const points = [];
  const point = new Vector3();
  for (const [number, mesh] of meshes.entries()) {
    const { index } = mesh.geometry;
    for (let place = 0; place < sizes[number]; place += step) {
      mesh.getVertexPosition(index ? index.getX(place) : place, point).applyMatrix4(mesh.matrixWorld);
      points.push(point.x, point.y, point.z);
    }
  }
  return Float32Array.from(points);
}

/**
 * Where the object stands in the lens array's coordinates: as `frame_scene` of `renderer/framing.py`.
 * @param {Float32Array} points
 * @param {Stand} stand
 */
function frame(points, { rows, cols, v, u, up, rotate, zoom, place }) {
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
  const tx = (Math.floor(u / 2) - (u - 1) / 2) * delta, ty = ((v - 1) / 2 - Math.floor(v / 2)) * delta; // of the centre view
  const matrix = new Matrix4();
  matrix.elements[8] = tx;
  matrix.elements[9] = ty;
  matrix.multiply(new Matrix4().makeScale(scale, scale, scale));
  matrix.multiply(new Matrix4().makeTranslation(-middle.x, -middle.y, -plane)).multiply(turn);
  return { matrix, near: scale * (plane - high.z - gap), far: scale * (plane - low.z + gap) };
}
