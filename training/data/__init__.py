"""Training data: pictures, degradations, crops, layered scenes and rendered views."""
