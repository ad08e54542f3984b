"""Offline training with torch: networks, degradations, losses, recipes and the export to ONNX.

Nothing here is needed, or imported, at run time.
"""
