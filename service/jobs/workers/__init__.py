"""Consumers of the queue, and the worker processes that reconstruct."""
