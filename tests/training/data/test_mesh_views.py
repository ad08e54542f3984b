"""Views of meshes as training pairs."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs torch, of the training extra")
import torch
from PIL import Image

from ciir.models.light_field.planes import Range, describe_window, place_planes
from ciir.models.light_field.windows import select_axis
from ciir.renderer.scenes import load_scene
from ciir.training.data.light_field.layered_scenes import LUMA
from ciir.training.data.mesh_views import LENSES, MOVED, read_mesh, render_pairs, render_window
from ciir.training.networks.plane_sweep import PlaneSweep

PLANES = 21
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    file = tmp_path_factory.mktemp("mesh") / "a.obj"
    file.write_text(TETRAHEDRON)
    return file


@pytest.mark.parametrize(("index", "scale"), [(0, 2), (1, 2), (2, 2), (1, 4)])
def test_the_truth_is_aligned_with_the_views(index, scale):
    """For each size of array: cell means of the truth are the lenslets' views, and not those of a lens further."""
    (pinhole, truth), (lenslet, same) = render_pairs(load_scene("globe"), seed=4, index=index, scale=scale)
    assert same is truth
    assert (pinhole.shape, lenslet.shape, truth.shape) == ((96, 96, 3), (96, 96, 3), (96 * scale, 96 * scale, 3))
    mean = truth.reshape(96, scale, 96, scale, 3).mean((1, 3))
    aligned = np.abs(lenslet - mean).mean()
    for shifted in (np.roll(mean, 1, 0), np.roll(mean, 1, 1)):
        assert np.abs(lenslet - shifted).mean() > 3 * aligned
    assert np.abs(pinhole - mean).mean() > aligned
    assert (truth != truth[0, 0]).any(axis=2).mean() > 0.1  # the object shows


@pytest.mark.parametrize("index", [0, 1])
def test_a_window_of_views_is_in_the_order_that_the_sweep_takes(index):
    """Rows of views down, columns across, both growing the same way: in any other order the views agree less. Content
    moves from one view to the next within the range that is given."""
    own = (2, 2) if index else (0, 3)
    field = render_window(load_scene("vase"), seed=2, index=index, own=own)
    assert field.own == own
    side = LENSES[1 + index]
    assert field.high.shape == (3, 2 * side, 2 * side)
    wide = Range(-1.25, 1.25)
    low, high = field.disparities
    assert -MOVED[1] <= low < high <= 0

    def sweep(views, rows, cols):
        filters = describe_window(rows, cols, wide, PLANES)[:2]
        return PlaneSweep()(views, *(torch.from_numpy(of.copy()) for of in filters))[1]

    for kind in ("pinhole", "lenslet"):
        assert (field.views[kind].shape, field.colours[kind].shape) == ((25, side, side), (3, side, side))
        luma = torch.einsum("chw,c->hw", field.colours[kind].float(), torch.tensor(LUMA))
        assert (field.views[kind][5 * own[0] + own[1]] - luma).abs().max() <= 0.51  # is rounded
        grid = field.views[kind].float().div(255).reshape(5, 5, side, side)
        (row, col), last = own, 4
        orders = [
            (grid, row, col),
            (grid.flip(0), last - row, col),
            (grid.flip(1), row, last - col),
            (grid.transpose(0, 1), col, row),
        ]
        spreads = [
            sweep(views.reshape(1, 25, side, side), *(select_axis(at, 5) for at in places)) for views, *places in orders
        ]
        best = [spread.amin(1) for spread in spreads]
        right, *wrong = [float((spread - spread.min()).mean()) for spread in best]  # over that of one flat colour
        assert right < 0.75 * min(wrong)
        planes = place_planes(wide, PLANES)
        inside = (planes >= low - 0.125) & (planes <= high + 0.125)
        shown = spreads[0][0].amax(0) > 0.05  # where the planes differ
        assert inside[spreads[0][0].argmin(0)[shown]].mean() > 0.7  # 0.4 by chance
    mean = field.high.float().reshape(3, side, 2, side, 2).mean((2, 4))
    aligned = (field.colours["lenslet"] - mean).abs().mean()
    for axis_of in (1, 2):
        assert (field.colours["lenslet"] - mean.roll(1, axis_of)).abs().mean() > 3 * aligned


def test_a_picture_depends_only_on_its_number(mesh):
    one, again, other = (render_pairs(read_mesh(mesh), seed=1, index=index, scale=2) for index in (3, 3, 4))
    np.testing.assert_array_equal(one[0][1], again[0][1])
    assert not np.array_equal(one[0][1], other[0][1])


def test_files_that_are_no_mesh(tmp_path, capsys):
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"a\.png: holds pictures, not a mesh"):
        read_mesh(tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"gone\.obj"):
        read_mesh(tmp_path / "gone.obj")
    (tmp_path / "b.obj").write_text("mtllib none.mtl\n" + TETRAHEDRON)
    read_mesh(tmp_path / "b.obj")
    assert "none.mtl" in capsys.readouterr().err
