"""Runs the command line: `python -m ciir`."""

import sys

from ciir.service.cli.main import main

sys.exit(main())
