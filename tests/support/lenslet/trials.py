"""Measures how well raw lenslet pictures are calibrated from themselves: `python -m tests.support.lenslet.trials [N]`.

There are N pictures (default 12) for each background, with both grids, the three shipped scenes, random pitches from 7
to 40 pixels, offsets and rotations within 2 degrees, and lenses that keep 10, 30 or 60 % of their light at the border.
It prints the table of docs/formats.md.
"""

from __future__ import annotations

import sys

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.lenslet.calibration import calibrate
from ciir.renderer.readers.lenslet.grid import LensGrid
from ciir.renderer.readers.lenslet.resampling import fit_pixels, place_views, resample_views
from tests.support.lenslet.camera import EDGE, dim, make_camera, take_picture

BACKGROUNDS = {"black": 0, "grey": 128, "white": 255}


def measure_errors(found, known, size):
    """Measures two errors in pixels: of pitch times lenses in a row, and of the lens in the picture's middle."""
    middle = known.find_centers(*known.find_nearest((np.array(size) - 1) / 2))
    moved = found.find_centers(*found.find_nearest(middle)) - middle
    return abs(found.pitch - known.pitch) * size[1] / known.pitch, np.hypot(*moved)


def measure_loss(camera, picture, found, edge=EDGE):
    """Measures by how many dB the worst of four views with the grid `found` differs from that with the known one.

    Both are compared with rays through the known lenses.
    """
    count = fit_pixels(camera.grid)
    pixels, middle = (count, count), count // 2
    of_found, of_known = (resample_views(picture, grid, pixels) for grid in (found, camera.grid))
    rows, along = place_views(camera.grid, camera.size, pixels)
    assert of_found.shape == of_known.shape
    places = camera.grid.find_positions(rows[:, None], along)
    losses = []
    for v, u in ((middle, middle), (0, middle), (middle, count - 1), (1, 1)):
        offset = np.array([v - middle, u - middle], float)
        rays = camera.cast(places.reshape(-1, 2), np.broadcast_to(offset, (places.size // 2, 2)))
        direct = rays.reshape(*places.shape[:2], 3) * dim(camera.grid, offset, edge)
        errors = [np.square(views[v, u] - direct).mean() for views in (of_found, of_known)]
        losses.append(abs(10 * np.log10(errors[0] / errors[1])))
    return max(losses)


def run_trial(random, number, level):
    """Returns the two errors, the uncertainty and the loss; None if the picture is refused or has the other shape."""
    shape, scene = ("square", "hexagonal")[number % 2], ("vase", "globe", "hamburger")[number // 2 % 3]
    pitch, rotation, edge = 7 * (40 / 7) ** random.random(), random.uniform(-2, 2), random.choice([0.1, 0.3, 0.6])
    grid = LensGrid(pitch, tuple(random.uniform(0, pitch, 2)), rotation, shape)
    side = int(np.clip(48 * pitch, 400, 1000))
    camera = make_camera(scene, grid, (side, side + 60), (level,) * 3)
    picture = take_picture(camera, edge=edge)
    try:
        found = calibrate(picture)
    except Unreadable:
        return None
    if found.grid.shape != shape:
        return None
    try:
        loss = measure_loss(camera, picture, found.grid, edge)
    except AssertionError:  # one row or column more or less at the border
        loss = np.nan
    return *measure_errors(found.grid, grid, camera.size), found.uncertainty, loss


def main(count):
    random = np.random.default_rng(7)
    results = {name: [] for name in BACKGROUNDS}
    for number in range(count):
        for name, level in BACKGROUNDS.items():
            results[name].append(run_trial(random, number, level))
    print(
        "| background | found | pitch times lenses within 0.05 | median | worst | within 2 standard errors | offset "
        "within 0.1 | median | worst | views within 0.5 dB |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name, errors in results.items():
        found = np.array([error for error in errors if error is not None])
        over_all, offset, uncertainty, loss = found.T
        cells = [
            f"{(error <= limit).sum()} | {np.median(error):.3f} | {error.max():.3f}"
            for error, limit in ((over_all, 0.05), (offset, 0.1))
        ]
        cells.insert(1, f"{(over_all <= 2 * uncertainty).sum()}")
        cells.append(f"{(loss <= 0.5).sum()} of {np.isfinite(loss).sum()}")
        print(f"| {name} | {len(found)} of {count} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
