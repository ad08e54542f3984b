"""Writes pictures, views and light fields: one registry of picture formats, one of formats for several views."""
