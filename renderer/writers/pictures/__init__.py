"""Encodes pictures: PNG, TIFF, JPEG and WebP."""

from ciir.renderer.writers.pictures.registry import BY_SUFFIX, FORMATS, SUFFIXES, PictureFormat, encode, encode_png

__all__ = ["BY_SUFFIX", "FORMATS", "SUFFIXES", "PictureFormat", "encode", "encode_png"]
