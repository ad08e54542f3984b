"""Accuracy of networks on test sets, by the published protocols."""
