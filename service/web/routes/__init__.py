"""The routes of the HTTP API and what they share."""
