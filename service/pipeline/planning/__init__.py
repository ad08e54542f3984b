"""Decides how a job is done: its strategy, backend and model, based on the predicted cost of each."""
