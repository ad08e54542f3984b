"""Upscales picture files: the job of `ciir upscale`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption
from ciir.models import catalogue
from ciir.models.single.skipping import SkipStatistics
from ciir.renderer.displays.quilt import parse_name
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.renderer.readers import pictures, png
from ciir.renderer.readers.layout import TEXT
from ciir.renderer.readers.metadata import colour_profiles
from ciir.renderer.writers.pictures import encode
from ciir.service.pipeline.limits import check_size
from ciir.service.pipeline.options import AUTO, NO_MODEL
from ciir.service.pipeline.report import Clock, Report, find_versions
from ciir.service.pipeline.stages.upscaling import describe_average, describe_model, describe_skipped

if TYPE_CHECKING:
    from ciir.renderer.readers.pictures import Pixels
    from ciir.service.pipeline.run import Progress

Write = Callable[[str, bytes], object]
"""Takes an output file's name and its bytes."""
_LOSSLESS = (".png", ".tif", ".tiff")


def output_names(inputs: list[str]) -> dict[str, str]:
    """Maps input names to output names. PNG and TIFF keep their format; any other becomes a PNG, which keeps every bit.

    Raises `InvalidOption` if two inputs would make the same output.
    """
    names: dict[str, str] = {}
    taken: dict[str, str] = {}
    for name in inputs:
        path = PurePosixPath(name)
        output = str(path.with_suffix(suffix if (suffix := path.suffix.lower()) in _LOSSLESS else ".png"))
        if output in taken:
            raise InvalidOption(f"{name} and {taken[output]} would both be written as {output}; rename one of them")
        names[name] = output
        taken[output] = name
    return names


def upscale_files(
    files: Mapping[str, bytes],
    outputs: Mapping[str, str],
    write: Write,
    *,
    model: str,
    scale: int,
    skip: bool = True,
    limits: Limits = DEFAULT_LIMITS,
    max_pixels: int | None = None,
    progress: Progress | None = None,
    clock: Clock | None = None,
) -> Report:
    """Upscales the pictures that `outputs` names, one at a time, keeping their depth and channels. Returns the report.

    `files`: name to bytes. `outputs`: input name to output name, whose suffix selects the format (see `output_names`).
    `model`: a single-picture model; `auto` is the catalogue's default, whose pictures become means with bicubic
    interpolation if they don't fit their input (`models.single.finishing`). `skip`: whether pixels with a known result
    are skipped. `limits`: limits on the inputs. `max_pixels`: most pixels of an output.
    Raises `InputError` with the picture's name, and `ModelError`.
    """
    from ciir.models.single.finishing import average_misfit
    from ciir.models.single.pixels import upscale_pixels

    clock = clock or Clock()
    if model == NO_MODEL:
        raise InvalidOption("model: none leaves pictures as they are; give a model that `ciir models` lists")
    name_of_model = catalogue.picture_default_name() if model == AUTO else model
    with clock.stage("upscale"):
        upscaler = catalogue.load_upscaler(name_of_model, scale=scale)
    done: list[dict[str, Any]] = []
    if progress is not None:
        progress(0, len(outputs))
    statistics = SkipStatistics()
    profiles: dict[str, list[str]] = {}
    several: list[str] = []
    averaged: list[float] = []
    samples: list[str] = []
    for name, output in outputs.items():
        with clock.stage("decode"):
            pixels = pictures.decode(files[name], name=name, max_pixels=limits.pixels)
            if (profile := colour_profiles.name_profile(files[name])) is not None:
                profiles.setdefault(profile, []).append(name)
            samples += [note for note in pictures.note_samples(files[name]) if note not in samples]
            if _holds_views(name, files[name]):
                several.append(name)
        _encode(pixels[:1, :1], output)  # raises before the work starts if the format can't hold the picture
        check_size(pixels.shape[:2], scale, limit=max_pixels, what=name)
        with clock.stage("upscale"):
            large = upscale_pixels(upscaler, pixels[np.newaxis], skip=skip, statistics=statistics)[0]
            if model == AUTO and (share := average_misfit(large, pixels)):
                averaged.append(share)
        with clock.stage("encode"):
            write(output, _encode(large, output))
        height, width, channels = large.shape
        done.append(
            {
                "input": name,
                "file": output,
                "height": height,
                "width": width,
                "channels": channels,
                "bits": large.dtype.itemsize * 8,
            }
        )
        if progress is not None:
            progress(len(done), len(outputs))
    return {
        "pictures": done,
        "notes": [
            colour_profiles.describe_profile(profile, names[0] + (f" and {len(names) - 1} more" if names[1:] else ""))
            for profile, names in profiles.items()
        ]
        + [
            f"{name}: holds several views, and they were upscaled as one picture; `ciir convert` with a model upscales "
            "each of them"
            for name in several
        ]
        + ([describe_average("picture", averaged, len(done))] if averaged else [])
        + samples,
        "model": describe_model(name_of_model, scale),
        "skipped": describe_skipped(statistics),
        "timings_ms": clock.timings_ms(),
        "versions": find_versions("onnxruntime"),
    }


def _holds_views(name: str, data: bytes) -> bool:
    """Returns whether a picture says that it is a quilt, by its name, or another picture of several views by ciir."""
    is_written = data.startswith(png.SIGNATURE) and png.find_text(data, TEXT) is not None
    return is_written or parse_name(PurePosixPath(name).name) is not None


def _encode(pixels: Pixels, output: str) -> bytes:
    try:
        return encode(pixels, output[output.rindex(".") :])
    except InvalidOption as error:
        raise InvalidOption(f"{output}: {str(error).removeprefix('picture: ')}") from error
