from pathlib import Path

import numpy as np
from scipy import ndimage

from ciir.benchmarks.focus.scenes import MESHES, list_scenes, render_exact
from ciir.renderer.scenes import SCENES


def test_meshes_that_are_absent_are_reported(tmp_path):
    (tmp_path / "duck.glb").touch()
    names, missing = list_scenes(tmp_path)
    assert names == [*SCENES, "duck.glb"]
    assert missing == [name for name in MESHES if name != "duck.glb"]


def test_the_truth_explains_the_views():
    """Where the corner view is looked up by the true disparity it shows the centre one, but for what is hidden."""
    scene = render_exact("vase", Path("absent"), side=96)
    views, true = scene.light_field.views.astype(float), scene.disparity
    y, x = np.mgrid[:96, :96]

    def compare(disparity):
        place = y - 4 * disparity, x - 4 * disparity
        moved = np.dstack([ndimage.map_coordinates(views[8, 8, ..., c], place, order=3) for c in range(3)])
        return np.median(np.abs(moved - views[4, 4]).mean(axis=2)[8:-8, 8:-8])

    errors = [compare(true + wrong) for wrong in (-0.2, 0, 0.2)]
    assert errors[1] < 0.3 * min(errors[0], errors[2])
