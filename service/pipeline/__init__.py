"""The main job: options and an input are resolved to one frozen job, the job to a plan, and the plan to views and a
report."""
