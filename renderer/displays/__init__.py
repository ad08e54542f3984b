"""Pictures for displays: quilts and native pictures of lenticular displays, and panels under a lens array."""
