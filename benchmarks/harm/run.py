"""Runs the whole harm table: reads inputs, runs every case, and writes the tables and the figure."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tqdm import tqdm

from ciir.benchmarks import machine
from ciir.benchmarks.bench.results import replace_infinite
from ciir.benchmarks.harm import light_fields, meshes, pictures, report
from ciir.benchmarks.harm.case import LIGHT_FIELD, MESH, PICTURE
from ciir.benchmarks.harm.figure import plot_harm
from ciir.benchmarks.harm.score import BOUND, Row, list_networks, make_subject, score_case
from ciir.errors import InvalidOption
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import find_main
from ciir.renderer.readers.registry import MeshFormat
from ciir.service.pipeline.options import AUTO, Options
from ciir.service.pipeline.source import Input

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from ciir.benchmarks.harm.case import Case, Kind, Picture, Views
    from ciir.renderer.scene import Scene
    from ciir.service.pipeline.source import Source

LINES = 15
"""How many of the worst cases are printed."""


@dataclass(frozen=True)
class HarmOptions:
    """The inputs, arrays and model to measure."""

    sources: Mapping[str, Source] = field(default_factory=dict)
    """Name -> mesh, elemental image array, set of views or folder of photographs, beyond those that ship. Names of
    scenes add nothing."""
    lenses: Sequence[int] = ()
    """Lenses along each side of the arrays in front of a mesh; if empty, `meshes.LENSES`, or `QUICK_LENSES` for
    `quick`."""
    array: Options = field(default_factory=Options)
    """How to read elemental image arrays."""
    kinds: Sequence[Kind] = (MESH, LIGHT_FIELD, PICTURE)
    model: str = AUTO
    """The model that is judged: `auto`, a name in the catalogue, or the path of an exported network's card."""
    quick: bool = False
    """Only two meshes in front of black and white, and a few cases of light fields and pictures."""


@dataclass(frozen=True)
class Inputs:
    """What cases are made from: name -> what was read, rendered or drawn."""

    scenes: dict[str, Scene] = field(default_factory=dict)
    captured: dict[str, tuple[Views, bool]] = field(default_factory=dict)
    """Light fields, and whether each is an elemental image array."""
    photographs: dict[str, Picture] = field(default_factory=dict)


QUICK_MESHES = ("vase", "grey chair")
QUICK_LENSES = (16, 32)
QUICK_BACKGROUNDS = ("black", "white")


def measure_harm(options: HarmOptions, out: Path) -> dict[str, Any]:
    """Measures, writes `harm.json`, `harm.md` and `harm.png` into `out`, and returns the content of the JSON file.

    Raises the input errors of `ciir.errors`, and `ModelError` if there is no such model.
    """
    begun = time.perf_counter()
    subject = make_subject(options.model)
    networks, left_out = list_networks()
    cases, count = _list_cases(options, _read_inputs(options))
    bar = tqdm(cases, total=count, disable=None, unit="case", file=sys.stderr)
    rows = sorted((score_case(case, networks, subject) for case in bar), key=lambda row: row.margin)
    here = machine.describe()
    found: dict[str, Any] = {
        "machine": here,
        "judged": options.model,
        "bound": BOUND,
        "cases": len(rows),
        "over": sum(row.is_over for row in rows),
        "left_out": left_out,
        "rows": [report.describe_row(row) for row in rows],
        "seconds": time.perf_counter() - begun,
    }
    _write(found, rows, out)
    return found | {"lines": [report.format_line(row) for row in rows[:LINES]]}


def _write(found: Mapping[str, Any], rows: Sequence[Row], out: Path) -> None:
    here = found["machine"]
    summary = (
        f"{found['over']} of {found['cases']} cases over the bound of {BOUND} dB; judged: {found['judged']}. "
        f"{here['processor']}, {here['cores']} cores, int8 {'yes' if here['int8'] else 'no'}; "
        f"{found['seconds']:.0f} s."
    )
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(replace_infinite(dict(found)), indent=1, allow_nan=False)
    (out / "harm.json").write_text(text + "\n", encoding="utf-8")
    lines = [summary, "", *report.format_tables(rows)]
    lines += [f"- `{name}`: left out: {why}" for name, why in found["left_out"].items()]
    (out / "harm.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    plot_harm(rows, out / "harm.png", title=summary)


def _read_inputs(options: HarmOptions) -> Inputs:
    """Reads meshes, light fields and pictures. Skips kinds that are not wanted.

    Everything is read before the first case runs, so that a wrong input is reported at once.
    """
    found = Inputs()
    if MESH in options.kinds:
        found.scenes.update({name: meshes.OWN[name]() for name in (QUICK_MESHES if options.quick else meshes.OWN)})
    for name, source in options.sources.items():
        if not isinstance(source, Bundle):
            continue
        kind, is_array = _find_kind(source, options.kinds)
        if kind not in options.kinds:
            continue
        if name in found.scenes or name == light_fields.DRAWN:
            raise InvalidOption(f"{name}: this is the name of an input that ships; rename the file")
        if kind == MESH:
            found.scenes[name] = Input(source).read_mesh(Options())
        elif kind == PICTURE:
            found.photographs.update(pictures.read_photographs(name, source))
        else:
            array = options.array if is_array else Options()
            found.captured[name] = (light_fields.read_light_field(name, source, array), is_array)
    if LIGHT_FIELD in options.kinds and not found.captured:
        found.captured[light_fields.DRAWN] = (light_fields.draw_light_field(quick=options.quick), False)
    if PICTURE in options.kinds and not found.photographs:
        found.photographs.update(pictures.draw_pictures(quick=options.quick))
    return found


def _find_kind(source: Bundle, kinds: Sequence[Kind]) -> tuple[Kind, bool]:
    """Returns the kind of an input, and whether a light field is one file, such as an elemental image array.

    Pictures are photographs if their names end with `pictures.HIGH`, or if no other kind is wanted.
    """
    main = find_main(source)
    if main is not None and isinstance(main[0], MeshFormat):
        return MESH, False
    is_photographs = any(key.endswith(pictures.HIGH) for key in pictures.list_photographs(source))
    return (PICTURE if is_photographs or tuple(kinds) == (PICTURE,) else LIGHT_FIELD), main is not None


def _list_cases(options: HarmOptions, inputs: Inputs) -> tuple[Iterator[Case], int]:
    """Returns the cases, made one after another, and their number."""
    lenses = options.lenses or (QUICK_LENSES if options.quick else meshes.LENSES)
    backgrounds = QUICK_BACKGROUNDS if options.quick else tuple(meshes.BACKGROUNDS)
    variations = {
        name: light_fields.list_variations((views.shape[0], views.shape[1]), is_array=is_array, quick=options.quick)
        for name, (views, is_array) in inputs.captured.items()
    }
    corruptions = pictures.list_variations(quick=options.quick)
    count = len(inputs.scenes) * meshes.count_cases(lenses, backgrounds) + sum(map(len, variations.values()))

    def make() -> Iterator[Case]:
        for name, scene in inputs.scenes.items():
            yield from meshes.list_cases(name, scene, lenses, backgrounds)
        for name, (views, _) in inputs.captured.items():
            yield from light_fields.list_cases(name, views, variations[name])
        for name, picture in inputs.photographs.items():
            yield from pictures.list_cases(name, picture, corruptions)

    return make(), count + len(inputs.photographs) * len(corruptions)
