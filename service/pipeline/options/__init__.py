"""Options and kinds of jobs: one table each, for the command line, HTTP and Python."""

from ciir.service.pipeline.options.kinds import KINDS, Kind, KindName
from ciir.service.pipeline.options.options import (
    AUTO,
    AUTO_MODEL,
    MAX_SCALE,
    NAMES,
    NO_MODEL,
    OPTIONS,
    Backend,
    Options,
    Sampling,
    Strategy,
    write_texts,
)
from ciir.service.pipeline.options.values import read_pair

__all__ = [
    "AUTO",
    "AUTO_MODEL",
    "KINDS",
    "MAX_SCALE",
    "NAMES",
    "NO_MODEL",
    "OPTIONS",
    "Backend",
    "Kind",
    "KindName",
    "Options",
    "Sampling",
    "Strategy",
    "read_pair",
    "write_texts",
]
