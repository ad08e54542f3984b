"""A mesh or an elemental image array -> view images."""
