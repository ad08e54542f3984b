"""Disparity maps as files: PFM, PNG of 16 bit, npy, and pictures to look at."""

from ciir.renderer.writers.depth.maps import FORMATS, MapFormat, encode_disparity, find_format, write_disparity

__all__ = ["FORMATS", "MapFormat", "encode_disparity", "find_format", "write_disparity"]
