"""Hostile input: what reads what strangers send, as functions of bytes, and millions of bytes for them."""
