"""Reads what picture files hold beside their pixels."""
