"""Export of trained networks to ONNX files with cards, in float and int8."""
