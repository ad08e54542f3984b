"""Draws the pictures of docs/focus.md.

python -m ciir.benchmarks.focus.figures [--captured ../shared/data/lightfields] [--out docs/images]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image

import ciir
from ciir.benchmarks.focus.scenes import render_exact
from ciir.renderer.views import center_view
from ciir.renderer.writers.depth.colors import color_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

DEPTHS = (30, 50, 75, 105, 140, 200)
"""Depths of the stack, in millimetres."""
LINES = (60, 120, 150)
"""Rows of the centre view with epipolar plane images."""
ZOOM, HEIGHT = 2, 6
"""Pixels for each pixel of a view, and for each row of an epipolar plane image."""


def main(argv: list[str] | None = None) -> int:
    """Writes `focus_stack.jpg`, `focus_disparity.png` and `focus_epi.png`."""
    parser = argparse.ArgumentParser(prog="benchmarks.focus.figures", description=main.__doc__)
    parser.add_argument("--captured", type=Path, default=Path("../shared/data/lightfields"))
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    args = parser.parse_args(argv)
    stack = draw_stack(ciir.open(args.captured / "saii-5x5"))
    Image.fromarray(stack).save(args.out / "focus_stack.jpg", quality=85)
    found = ciir.open(args.captured / "lytro-2067").disparity().hci
    disparity = color_map(found, *np.quantile(found, (0.005, 0.995)))
    Image.fromarray(disparity).quantize(64).save(args.out / "focus_disparity.png", optimize=True)
    epi = draw_epi(render_exact("hamburger", Path(), side=240, views=15).light_field)
    Image.fromarray(epi).quantize(128).save(args.out / "focus_epi.png", optimize=True)
    return 0


def draw_stack(light_field: ciir.LightField) -> NDArray[np.uint8]:
    """Draws planes at `DEPTHS`, at half size, in rows of three."""
    cameras = ciir.DepthScale.from_cameras(
        pitch=2, focal_length=35, sensor_width=36, columns=light_field.views.shape[3]
    )
    planes = [picture[..., :3] for picture in light_field.planes(cameras.to_disparity(DEPTHS))]
    small = np.array([np.asarray(Image.fromarray(plane).reduce(2)) for plane in planes])
    return np.vstack([np.hstack(list(row)) for row in (small[:3], small[3:])])


def draw_epi(light_field: ciir.LightField) -> NDArray[np.uint8]:
    """Draws the centre view with `LINES` in white, and below it their epipolar plane images."""
    view = light_field.view(*center_view(*light_field.views.shape[:2])).copy()
    view[LINES, :] = 255
    rows = [view.repeat(ZOOM, 0)]
    for y in LINES:
        rows += [np.full_like(rows[0][:4], 255), light_field.epi(y=y).repeat(HEIGHT, 0)]
    return np.vstack(rows).repeat(ZOOM, 1).astype(np.uint8)


if __name__ == "__main__":
    sys.exit(main())
