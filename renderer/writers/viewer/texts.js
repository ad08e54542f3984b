// @ts-check
/** Every text of the viewer. They are put into markup: no text from elsewhere may come in. */
export const VIEWER_TEXTS = {
  picture: "The light field. Arrow keys move the viewpoint; a click focuses on a thing.",
  far: "Far",
  near: "Near",
  depth: "Depth in focus",
  aperture: "Aperture",
  tour: "Tour",
  tilt: "Tilt the device",
  loading: "Loading",
  loadingViews: (/** @type {number} */ done, /** @type {number} */ total) => `Loading view ${done} of ${total}`,
  place: (/** @type {string} */ v, /** @type {string} */ u, /** @type {string} */ focus) =>
    `View ${v}, ${u}. Focus ${focus} pixels per view.`,
  flat: "The depth of that spot can't be measured; click an edge or a pattern.",
  noWebgl: "This browser has no WebGL 2; switch on hardware acceleration, or use a newer one.",
  lostWebgl: "WebGL was lost; load the page again.",
  noCanvas: "The browser refused a canvas; close other pages and load this one again.",
  noTilt: "This device reports no tilt; drag the picture instead.",
  tooMany: (/** @type {number} */ views, /** @type {number} */ most) =>
    `${views} views; this graphics processor holds ${most}. Write fewer views.`,
};
