"""HTTP in front of jobs: it reads forms, asks for jobs and sends results, and never decodes what clients send."""
