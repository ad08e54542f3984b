"""Stereo matching: finds the disparity that fits each pixel of a view, in clean and in noisy views."""
