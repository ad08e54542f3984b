"""Options and kinds of jobs: one table each, shared by the command line, HTTP and Python."""

from ciir.service.pipeline.options.displays import DISPLAYS
from ciir.service.pipeline.options.focus import FOCUS
from ciir.service.pipeline.options.kinds import (
    FILE_TYPES,
    KINDS,
    MODEL_FIRST,
    MODELS,
    ONE_POSE,
    Kind,
    KindName,
    find_plane_format,
)
from ciir.service.pipeline.options.lenslet import LENSLET
from ciir.service.pipeline.options.mesh import MESH, Backend, Moment, Sampling
from ciir.service.pipeline.options.options import NAMES, OPTIONS, RECONSTRUCTION, Options, write_texts
from ciir.service.pipeline.options.reading import READING
from ciir.service.pipeline.options.upscaling import AUTO, AUTO_MODEL, MAX_SCALE, NO_MODEL, UPSCALING, Strategy
from ciir.service.pipeline.options.values import read_pair
from ciir.service.pipeline.options.writing import WRITING

__all__ = [
    "AUTO",
    "AUTO_MODEL",
    "DISPLAYS",
    "FILE_TYPES",
    "FOCUS",
    "KINDS",
    "LENSLET",
    "MAX_SCALE",
    "MESH",
    "MODELS",
    "MODEL_FIRST",
    "NAMES",
    "NO_MODEL",
    "ONE_POSE",
    "OPTIONS",
    "READING",
    "RECONSTRUCTION",
    "UPSCALING",
    "WRITING",
    "Backend",
    "Kind",
    "KindName",
    "Moment",
    "Options",
    "Sampling",
    "Strategy",
    "find_plane_format",
    "read_pair",
    "write_texts",
]
