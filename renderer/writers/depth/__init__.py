"""Writes disparity maps as files: PFM, TIFF, 16-bit PNG, npy, and pictures to look at."""

from ciir.renderer.writers.depth.maps import FORMATS, MapFormat, encode_disparity, find_format, write_disparity

__all__ = ["FORMATS", "MapFormat", "encode_disparity", "find_format", "write_disparity"]
