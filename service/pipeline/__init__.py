"""The main job: options and an input become one frozen job, the job a plan, and the plan views and a report."""
