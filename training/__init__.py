"""Offline training with torch: networks, degradations, losses, recipes and the export to ONNX."""
