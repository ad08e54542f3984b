"""Training data: pictures, degradations, crops, labels and rendered views; `light_field` for light-field networks."""
