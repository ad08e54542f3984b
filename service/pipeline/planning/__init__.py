"""Decides how a job is done: its strategy and model, by times that are predicted for a typical machine."""
