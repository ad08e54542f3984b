"""The demo: the shipped scenes from mesh to upscaled view."""
