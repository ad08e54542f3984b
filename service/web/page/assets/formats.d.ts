/** The names of formats, from the server's registries: see `MADE` in `routes.py`. */
/** Formats of one picture. */
export const PICTURES: string[];
/** Formats of frames. */
export const VIDEOS: string[];
/** Formats of all views that need no more options. */
export const WHOLE: string[];
/** Formats of several depth planes. */
export const STACKS: string[];
/** Formats of disparity maps. */
export const MAPS: string[];
