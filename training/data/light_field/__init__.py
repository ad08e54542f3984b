"""Training data for light-field networks: layered scenes, their crops, camera differences, and folders of views."""
