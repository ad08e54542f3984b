"""Applies to every request and connection: limits, timeouts, API keys, ids and logs."""
