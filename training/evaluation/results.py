"""Scores of pictures and light fields against their truth."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ciir.renderer.readers.registry import is_picture
from ciir.training.data.light_field.views import read_light_field
from ciir.training.evaluation import light_fields, pictures
from ciir.training.evaluation.folders import compare_by_name, is_set, read_picture
from ciir.training.evaluation.maps import is_map
from ciir.training.evaluation.metrics import average, compute_psnr, convert_to_luma
from ciir.training.evaluation.pairs import White, check_sizes, score_views

if TYPE_CHECKING:
    from pathlib import Path

    from ciir.renderer.light_field import LightField
    from ciir.renderer.readers.layout import Layout

CLOSER = 1.0
"""By how many dB a view must be closer to the opposite view of the truth for a note."""
PROTOCOL = (
    "Mean over the views or pictures of PSNR (dB) and SSIM of Y (ITU-R BT.601, studio range, not rounded, of 8-bit "
    "RGB; grey is its own Y) after rounding to 8 bits; a border of `scale` pixels is cut. White of 16-bit files is the "
    "largest level of the bits that the truth uses (8, 10, 12, 14 or 16; 16 if the truth has 8-bit files), and higher "
    "levels of results are clipped. SSIM: Wang et al. 2004, 11x11 Gaussian window of sigma 1.5, valid region, K 0.01 "
    "and 0.03, L 255. Disparity maps: BadPix(0.07), the share of pixels whose disparity is off by more than 0.07, and "
    "100 times the mean square error, as in the HCI 4D light field benchmark, over the pixels that are finite in the "
    "truth and whose confidence in the truth's NAME_confidence, if there is that file, isn't 0."
)


def compare(
    result: Path, truth: Path, *, border: int, layout: Layout | None = None
) -> light_fields.Measured | pictures.Measured:
    """Scores each view or picture of `result` against that of `truth`, of the same size.

    A border of `border` pixels is cut. Both are pictures or light fields. If they are folders or zips, and one of them
    isn't a whole grid of views, their pictures are compared by name (`folders.compare_by_name`). `layout`: how views
    lie in both files, if the caller knows; pictures are then read as light fields. If views are counted from other ends
    in the two files, they are compared in the same order.

    Raises `ValueError` if one can't be read, or their views differ in number, size or channels.
    """
    for path in (result, truth):
        if not path.exists():
            raise ValueError(f"{path}: no such folder or file; give a result and its truth")
    if layout is None and is_map(result):
        raise ValueError(
            f"{result}: a disparity map, but {truth} isn't one; give pictures or light fields, or two maps"
        )
    are_sets = layout is None and is_set(result) and is_set(truth)
    try:
        found, true = (_read_views(path, layout) for path in (result, truth))
    except ValueError:
        if are_sets:
            return compare_by_name(result, truth, border=border)
        raise
    if are_sets and (1, 1) in (found.views.shape[:2], true.views.shape[:2]):  # their places in a grid aren't read
        return compare_by_name(result, truth, border=border)
    return _compare_views(found, true, (result, truth), border=border)


def _compare_views(
    found: LightField, true: LightField, paths: tuple[Path, Path], *, border: int
) -> light_fields.Measured:
    result, truth = paths
    notes = [*found.notes, *(note for note in true.notes if note not in found.notes)]
    if found.depth_sense != true.depth_sense and found.views.shape[:2] != (1, 1):
        found = found.flip("uv")
        notes.append(f"views of {result.name} are counted from the other end than those of {truth.name}: put right")
    made, wanted = found.views, true.views
    check_sizes(str(result), made, str(truth), wanted, border=border)
    white = White([wanted])
    made, wanted = white.convert(made, wanted)
    scores = score_views(made, wanted, border=border)
    if len(scores) > 1:
        opposite = compute_psnr(convert_to_luma(made[0, 0]), convert_to_luma(wanted[-1, -1]), border=border)
        if opposite > scores[0, 0][0] + CLOSER:
            notes.append(
                f"view 0,0 of {result.name} is closer to the last view of {truth.name} than to its first: one of them "
                "may count views from the other end; convert it with flip uv"
            )
    notes += white.describe(result.name, truth.name)
    return light_fields.Measured(average(result.name, scores), scores, tuple(notes))


def _read_views(path: Path, layout: Layout | None) -> LightField:
    if layout is None and path.is_file() and is_picture(path.name):
        return read_picture(path.read_bytes(), path)
    return read_light_field(path, layout=layout, least=1, takes_one=True)
