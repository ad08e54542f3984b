"""Decides how a job is done: the strategy, the backend and the model, by what each is predicted to cost."""
