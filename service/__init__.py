"""The whole job put together: the pipeline, and the command line and the HTTP API, which add nothing to it."""
