"""Display pictures from any input: quilts, native pictures of lenticular displays, and panels under a lens array."""
