// @ts-check
/** All texts that the page shows. */
export const TEXTS = {
  // the start
  title: "Look around in a light field",
  intro: "A lens array records a scene from many viewpoints at once. This page makes these views from such a recording or from "
    + "a mesh, and then makes them larger and sharper. Drop a file, or begin with an example.",
  drop: "Drop a file here, or choose one",
  takes: "A mesh, an elemental image array, a raw lenslet picture, or several views",
  takesMeshes: "An OBJ with its MTL and textures, a folder or a zip works too",
  folder: "Choose a folder",
  examples: "Examples",
  vase: "Vase",
  globe: "Globe",
  hamburger: "Hamburger",
  local: "Files are sent only to this server.",
  recent: "Recent jobs",
  forget: "Forget these",
  // what is open
  close: "Another file",
  picture: "Picture",
  lightField: "Light field",
  mapped: "As mapped",
  upscaled: "Upscaled",
  grid: "Lens grid",
  around: "Look around",
  compare: "Compare",
  bicubic: "Bicubic",
  truth: "Rendered at the larger size",
  depth: "Disparity",
  waiting: "The picture appears here.",
  noFiles: "The folder has no files. Choose one that has some.",
  changed: "The file was changed or removed after it was chosen. Choose it again.",
  needsLenses: "How many lenses does the picture show? Give their rows x columns, such as 50x50. To upscale an ordinary photo, use ciir upscale instead.",
  reading: "Reading the file",
  packing: "Packing the files",
  // settings
  settings: "Settings",
  array: "Lens array",
  grids: "Found in the picture",
  lenses: "Lenses, rows x columns",
  pixels: "Pixels under each lens, rows x columns",
  views: "Views",
  viewGrid: "Views, rows x columns",
  order: "Order of the views",
  checked: "Corrected if it is wrong",
  given: "As it is",
  rows: "First number is the row",
  columns: "First number is the column",
  serpentine: "Rows run back and forth",
  transpose: "Rows and columns of views",
  kept: "As they are",
  swapped: "Swapped",
  flip: "Reverse the views",
  none: "No",
  u: "From left to right",
  v: "From top to bottom",
  uv: "Both: swaps near and far",
  depth_sense: "Near and far",
  stated: "As the file says",
  cameras: "Numbered as cameras",
  underLenses: "Numbered as lens pixels",
  senseHelp: "If near things look far away, choose the other numbering.",
  lens_pitch: "Pixels from lens to lens, for a raw picture",
  lens_offset: "Centre of one lens, y,x in pixels",
  lens_rotation: "Rotation of the rows, in degrees",
  lens_grid: "Arrangement",
  found: "As found",
  square: "Square",
  hexagonal: "Hexagonal, in rows",
  hexagonalColumns: "Hexagonal, in columns",
  moveGrid: "Place of the lens grid: drag it, or press arrow keys",
  turnGrid: "Pitch and rotation of the lens grid: drag it, or press arrow keys",
  resizeGrid: "Corner of an elemental image: drag it, or press arrow keys",
  rawHelp: "Drag one ring to move the grid, the other to change its pitch and rotation.",
  cellsHelp: "Drag the ring to the corner of an elemental image.",
  auto: "Automatic",
  object: "Object",
  turnHelp: "Drag the picture to turn the object, or select it and press arrow keys, + and -.",
  aroundHelp: "Dragging moves the viewpoint; sliders turn the object.", compareHelp: "Dragging moves the pictures; sliders turn the object.",
  yaw: "Turn to the right",
  tilt: "Tilt forwards",
  roll: "Roll to the left",
  zoom: "Size",
  place: "Place",
  depth_factor: "Share of its depth",
  placeHelp: "-1 behind the lenses, 1 in front of them. Pictures for displays have it at 0 until you move it.",
  moment: "Time in the animation (glTF), in seconds",
  background: "Background",
  up: "Axis that points up",
  y: "y",
  z: "z, as in CAD",
  upscaling: "Upscaling",
  model: "Network",
  scale: "Times larger",
  // the job
  cancel: "Cancel",
  queued: "Waiting for its turn",
  cancelled: "Cancelled.",
  cancelledElsewhere: "Another window or program cancelled this job. Change a setting, or choose the picture again.",
  details: "Where the time went",
  retry: "Try again",
  key: "Key of this server",
  useKey: "Use key",
  // export
  export: "Export",
  format: "Format",
  download: "Download",
  device: "Model of the Looking Glass",
  calibration: "Calibration of the display, a JSON file",
  print: "Size of the print, such as 6x4in or 152x102mm",
  lpi: "Lenses per inch of the sheet",
  dpi: "Dots per inch of the printer",
  view_distance: "Viewing distance, such as 16in or 400mm; if empty, about 4 times the height",
  view_angle: "Viewing angle of the sheet, in degrees; if empty, 40",
  display: "Panel and lenses, a TOML file",
  time: "Times in seconds, from : to : count",
  rotate: "Turns to the right in degrees, from : to : count",
  stack: "Planes, from : to : count",
  disparity: "Disparity of the plane, in pixels per view",
  epi: "Row y=120, or column x=80",
  planeHelp: "Click in Look around on what should be sharp: its disparity is filled in here.",
  stackHelp: "Show the disparity in Look around: its range is filled in here.",
  calibrationHelp: "The file visual.json, which is stored on the display. For a print after a pitch test, write one like the example.",
  displayHelp: "Write one like the example, with lengths in millimetres.",
  example: "Example",
  larger: "Upscale the views first",
  largerHelp: "With the network and the size of the settings; it takes longer.",
};

/** The names of kinds of inputs. */
export const KINDS = /** @type {Record<string, string>} */ ({
  scene: "A shipped scene",
  mesh: "A mesh",
  eia: "An elemental image array",
  raw: "A raw lenslet picture",
  views: "A set of views",
  mosaic: "Views side by side in one picture",
  picture: "A picture",
});

/** The names of groups of export formats. */
export const GROUPS = /** @type {Record<string, string>} */ ({
  view: "The centre view",
  times: "The centre view of an animation",
  turntable: "The centre view on a turntable",
  all: "All views",
  displays: "For displays",
  elementals: "Elemental image array of the mesh",
  plane: "In focus at one depth",
  stack: "A stack of depth planes",
  disparities: "Depth",
});

/** Examples of files that describe displays; docs/displays.md explains their keys. */
export const EXAMPLES = /** @type {Record<string, string>} */ ({
  calibration: `{"pitch": 59.914, "DPI": 600,
 "screenW": 3600, "screenH": 2400,
 "slope": 10000, "center": 0,
 "viewCone": 40, "invView": 1,
 "subpixels": "none"}`,
  display: `[panel]
pixels = [1920, 1080]
ppi = 280   # pixels per inch

[lenses]
pitch = 1.0 # from lens to lens
gap = 3.0   # pixels to lenses

[viewer]
distance = 500 # from the lenses`,
});

/** The names of formats. */
export const FORMATS = /** @type {Record<string, string>} */ ({
  png: "PNG",
  tiff: "TIFF",
  jpeg: "JPEG",
  webp: "WebP",
  zip: "Pictures in a zip",
  html: "Web page with a viewer (HTML)",
  tiles: "Tiles for the viewer of this page (zip)",
  npz: "NumPy, with the report (npz)",
  npy: "NumPy (npy)",
  eia: "Elemental image array",
  mosaic: "Views side by side",
  eslf: "Lytro's ESLF",
  stack: "TIFF of many pages",
  mat: "MATLAB 5 (mat)",
  mat73: "MATLAB 7.3 (mat)",
  hci: "HCI data set (HDF5)",
  mp4: "Video (MP4)",
  webm: "Video (WebM)",
  gif: "Animation (GIF)",
  "animated-webp": "Animation (WebP)",
  epi: "Epipolar plane image (EPI)",
  quilt: "Quilt for a Looking Glass",
  lenticular: "Picture for a lenticular display",
  "displays print": "Lenticular print",
  panel: "Picture for a panel behind lenses",
  pfm: "Disparity in pixels (PFM)",
  viridis: "Disparity in colours (PNG)",
  glb: "Mesh (GLB)",
  ply: "Mesh (PLY)",
});

/** The names of networks and interpolations, with what they are for if their own name does not say it. */
export const MODELS = /** @type {Record<string, string>} */ ({
  best: "best: the sharpest for a single view, slowest",
  "best-int8": "best-int8: faster",
  bicubic: "Bicubic",
  nearest: "Nearest pixel",
  fast: "fast",
  "fast-int8": "fast-int8: the fastest",
  field: "field: uses the neighbouring views",
  "field-int8": "field-int8: faster",
  "field-quality": "field-quality: larger, slower",
  "field-quality-int8": "field-quality-int8: faster",
  gan: "gan: sharper, with invented detail",
  paper: "paper: as published",
  quality: "quality: sharp, for a single view",
  "quality-int8": "quality-int8: faster",
});

/** Descriptions of a job's settings, by their names; empty for usual values. */
const SETTINGS = /** @type {Record<string, (value: string) => string>} */ ({
  lenses: (value) => `${value} lenses`,
  pixels: (value) => `${value} pixels`,
  rotate: (value) => `turned by ${value.replaceAll(",", "°, ")}°`,
  zoom: (value) => `size ${value}`,
  depth_factor: (value) => `${value} of its depth`,
  time: (value) => `at ${value} s`,
  order: () => "in another order",
  transpose: () => "rows and columns swapped", flip: () => "reversed",
  depth_sense: (value) => (value === "lenses" ? TEXTS.underLenses : TEXTS.cameras).toLowerCase(),
  model: (value) => ({ auto: "", none: "not upscaled" }[value] ?? value),
  scale: (value) => (value === "2" ? "" : `${value} times larger`),
});

/** Sentences that contain numbers or names. */
export const SENTENCES = {
  /** @param {string} name @param {number} rows @param {number} cols */
  size: (name, rows, cols) => `${name}, ${cols} x ${rows} pixels`,
  /** @param {number} done @param {number} all */
  views: (done, all) => `${done} of ${all} views`,
  /** @param {number} share */
  share: (share) => `${Math.floor(100 * share)} %`,
  /** @param {number} share */
  sent: (share) => `Sending, ${SENTENCES.share(share)}`,
  /** @param {string} lenses @param {string} pixels */
  grid: (lenses, pixels) => `${lenses} lenses of ${pixels} pixels`,
  /** @param {number} pitch @param {number} rotation */
  rawGrid: (pitch, rotation) => `${pitch.toFixed(3)} pixels from lens to lens, rows turned by ${rotation.toFixed(3)}°`,
  /** @param {number} step */
  everyLens: (step) => `One in ${step} is drawn in each row and column`,
  /** @param {number} seconds */
  left: (seconds) => (seconds < 90 ? `about ${Math.ceil(seconds)} s left` : `about ${Math.round(seconds / 60)} min left`),
  /** @param {number} milliseconds */
  time: (milliseconds) => (milliseconds < 9950 ? `${Math.round(milliseconds)} ms` : `${(milliseconds / 1000).toFixed(1)} s`),
  /** @param {string} time @param {boolean} wasDone Whether the job was done before it was requested. */
  done: (time, wasDone) => `Done in ${time}${wasDone ? ", from an earlier run" : ""}`,
  /**
   * @param {string} name
   * @param {string} value
   */
  setting: (name, value) => SETTINGS[name]?.(value) ?? `${name} ${value}`,
  /** @param {number} time */
  date: (time) => new Date(time).toLocaleString("en-GB", { dateStyle: "medium", timeStyle: "short" }),
  /** @param {number} count */
  files: (count) => `${count} files`,
  /** @param {string} name */
  again: (name) => `Choose ${name} again; its settings are kept.`,
  /** @param {string} what @param {string} name */
  job: (what, name) => `${name}: ${what.toLowerCase()}`,
};

/** Texts of the light field, of the comparison of pictures, and of overlays. */
export const PICTURE_TEXTS = {
  noLightField: "The server's response is not a light field in tiles. Ask for format=tiles.",
  broken: "The connection broke before all views had arrived. Load the light field again.",
  disparity: "Disparity",
  disparityShown: "The disparity of the centre view: nearer parts are brighter.",
  measuring: "Measuring the disparity",
  epi: "EPI",
  epiShown: "This row of pixels from each view of the middle row of views, one below the other: the slope of a line is its disparity.",
  row: "Row of the EPI",
  compared: "Two pictures of one view. Wheel, pinch, + and - zoom; dragging and arrow keys move the picture.",
  left: "Picture on the left",
  right: "Picture on the right",
  divider: "Divider",
  zoom: "Zoom",
  difference: "Difference from the rendering, times 4",
  noCanvas: "The browser refused a canvas. Close other pages, then load this one again.",
  /** @param {string} name @param {{psnr: number, ssim: number}} [quality] */
  quality: (name, quality) =>
    quality && Number.isFinite(quality.psnr) ? `${name}: ${quality.psnr.toFixed(2)} dB, SSIM ${quality.ssim.toFixed(3)}` : name,
  making: "Making the views",
  nothing: "The address names no light field: give scene=vase and settings after #.",
  noJob: "The server no longer has this light field. Run its job again, and give the new id after #job=.",
};

/** Writes the texts into all elements that name one in `data-text`, or in `data-label` for assistive technology. */
export function writeTexts() {
  const read = (/** @type {string | undefined} */ name) => TEXTS[/** @type {keyof typeof TEXTS} */ (name)];
  for (const element of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-text], [data-label]"))) {
    const { text, label } = element.dataset;
    if (text) element.textContent = read(text);
    if (label) element.setAttribute("aria-label", read(label));
  }
}
