"""Stereo matching: which disparity fits each pixel of a view, and how noise and outlines are told apart."""
