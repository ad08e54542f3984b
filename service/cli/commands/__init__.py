"""The commands: one module each, with `run(args)`, imported when the command is given."""
