"""The harm table: where the default is worse than bicubic interpolation, or than the single-picture networks."""
