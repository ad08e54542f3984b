/** three.js brings no types. */
declare module "three";
declare module "three/addons/*";
