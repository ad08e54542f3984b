"""One module for each command of `ciir`, with `run(args)`; imported only when its command is given."""
