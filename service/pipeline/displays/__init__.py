"""Pictures for displays, from any input: quilts, native pictures of lenticular displays, panels under a lens array."""
