"""Stereo matching: which disparity fits each pixel of a view, in clean and in noisy views."""
