"""How well raw lenslet pictures are calibrated from themselves: `python -m tests.support.lenslet.trials [N]`.

N pictures (default 12) for each background: both grids, the three shipped scenes, random pitches from 7 to 40 pixels,
offsets and rotations within 2 degrees, and lenses that keep 10, 30 or 60 % of their light at the border. Prints the
table of docs/formats.md.
"""

from __future__ import annotations

import sys

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.lenslet.calibration import calibrate
from ciir.renderer.readers.lenslet.grid import LensGrid
from tests.support.lenslet.camera import make_camera, take_picture

BACKGROUNDS = {"black": 0, "grey": 128, "white": 255}


def measure_errors(found, known, size):
    """Of the pitch times the lenses of a row, and of the lens in the picture's middle, in pixels."""
    middle = known.find_centers(*known.find_nearest((np.array(size) - 1) / 2))
    moved = found.find_centers(*found.find_nearest(middle)) - middle
    return abs(found.pitch - known.pitch) * size[1] / known.pitch, np.hypot(*moved)


def run_trial(random, number, level):
    """The two errors; None where the picture is refused or the other shape is found."""
    shape, scene = ("square", "hexagonal")[number % 2], ("vase", "globe", "hamburger")[number // 2 % 3]
    pitch, rotation, edge = 7 * (40 / 7) ** random.random(), random.uniform(-2, 2), random.choice([0.1, 0.3, 0.6])
    grid = LensGrid(pitch, tuple(random.uniform(0, pitch, 2)), rotation, shape)
    side = int(np.clip(48 * pitch, 400, 1000))
    camera = make_camera(scene, grid, (side, side + 60), (level,) * 3)
    try:
        found = calibrate(take_picture(camera, edge=edge)).grid
    except Unreadable:
        return None
    return measure_errors(found, grid, camera.size) if found.shape == shape else None


def main(count):
    random = np.random.default_rng(7)
    results = {name: [] for name in BACKGROUNDS}
    for number in range(count):
        for name, level in BACKGROUNDS.items():
            results[name].append(run_trial(random, number, level))
    print(
        "| background | found | pitch times lenses within 0.05 | median | worst | offset within 0.1 | median | worst |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, errors in results.items():
        found = np.array([error for error in errors if error is not None])
        (over_all, offset), most = found.T, (0.05, 0.1)
        cells = [
            f"{(error <= limit).sum()} | {np.median(error):.3f} | {error.max():.3f}"
            for error, limit in zip((over_all, offset), most, strict=True)
        ]
        print(f"| {name} | {len(found)} of {count} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12)
