"""Runs the command line, `ciir` or `python -m ciir`. Ctrl-C ends it in order, also while its modules are imported."""

import sys


def main() -> int:
    """Runs the command line's own arguments and returns the exit status."""
    try:
        from ciir.service.cli.main import main as run
    except KeyboardInterrupt:
        print("ciir: interrupted", file=sys.stderr)
        return 130
    return run()


if __name__ == "__main__":
    sys.exit(main())
