"""The HTTP API. It accepts requests, submits them as jobs and sends results; it decodes no input itself."""
