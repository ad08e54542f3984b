"""The HTTP API: it takes requests in, hands them over as jobs and sends results; it decodes no input itself."""
