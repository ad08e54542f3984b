"""Writes pictures, views and light fields, with one registry of picture formats and one of formats for several
views.
"""
