"""The command line, `ciir`."""
