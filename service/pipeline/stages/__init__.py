"""The stages of a reconstruction: make views, upscale them, write them, in batches that overlap."""
