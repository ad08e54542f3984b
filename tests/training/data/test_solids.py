"""Random solids in front of a lens array."""

import numpy as np
import pytest
import trimesh

pytest.importorskip("torch", reason="training.data needs the training extra")

from ciir.training.data import rendered, solids
from ciir.training.data.solids import PLAIN, SHAPES, draw_background, make_solids

PICTURES = [np.random.default_rng(i).integers(0, 256, (40, 30, 3), dtype=np.uint8) for i in range(3)]
EXTENT = 50.0


def make(seed, count=40):
    return make_solids(np.random.default_rng(seed), PICTURES, extent=EXTENT, count=count)


def join(part):
    """Its surface, with the vertices joined that were split for their normals."""
    surface = trimesh.Trimesh(part.vertices, part.faces, process=False)
    surface.merge_vertices(digits_vertex=6)
    return surface


def test_solids_depend_only_on_the_generator():
    one, again, other = make(0), make(0), make(1)
    assert len(one) == 40
    for first, second in zip(one, again, strict=True):
        np.testing.assert_array_equal(first.vertices, second.vertices)
        np.testing.assert_array_equal(first.colors, second.colors)
        assert (first.texture is None) == (second.texture is None)
    assert not np.array_equal(one[0].vertices, other[0].vertices)


@pytest.mark.parametrize("number", range(len(SHAPES)))
def test_shapes_are_closed_and_about_as_large_as_a_unit_cube(number):
    shape = SHAPES[number]()
    assert shape.is_watertight
    assert shape.volume > 0
    largest = np.ptp(shape.vertices, axis=0).max()
    assert 0.9 < largest < 1.1


@pytest.mark.parametrize("seed", range(2))
def test_solids_are_closed_and_in_front_of_the_array(seed):
    """Within the extent, at the distances of polygons: 2 to 4 extents."""
    for part in make(seed):
        surface = join(part)
        assert surface.is_watertight
        assert surface.volume > 0  # its faces look outwards
        assert np.abs(part.vertices[:, :2]).max() < (0.35 + 1.1) * EXTENT
        assert part.vertices[:, 2].min() > -5.1 * EXTENT
        assert part.vertices[:, 2].max() < -0.9 * EXTENT


def test_plain_and_textured_solids_are_lit():
    """Light differs over a solid; beside it a plain one has a single colour, grey for half of them."""
    parts = make(2, 200)
    plain = [part for part in parts if part.texture is None]
    assert len(plain) / 200 == pytest.approx(PLAIN, abs=0.1)
    grey = [part for part in plain if np.ptp(part.colors[:, :3], axis=1).max() < 1e-6]
    assert len(grey) / len(plain) == pytest.approx(0.5, abs=0.12)
    for part in parts:
        assert part.colors.shape == (len(part.vertices), 4)
        assert 0 <= part.colors.min() <= part.colors.max() <= 1
        assert (part.colors[:, 3] == 1).all()
        brightest = part.colors[part.colors.sum(1).argmax(), :3]
        shades = part.colors[:, :3] @ brightest / (brightest @ brightest)
        np.testing.assert_allclose(part.colors[:, :3], shades[:, None] * brightest, atol=1e-5)
        assert np.ptp(shades) > 0.05
        assert (part.uv is None) == (part.texture is None)


def test_some_solids_are_thin_bars(monkeypatch):
    monkeypatch.setattr(solids, "BARS", 1.0)
    for part in make(3, 10):
        pieces = join(part).split(only_watertight=True)
        assert 2 <= len(pieces) <= 6
        for piece in pieces:
            sides = np.sqrt(np.linalg.eigvalsh(np.cov(piece.vertices.T)))
            assert sides[1] < 0.2 * sides[2]


def test_backgrounds():
    random = np.random.default_rng(0)
    drawn = [draw_background(random) for _ in range(2000)]
    assert all(isinstance(level, int) and 0 <= level <= 255 for colour in drawn for level in colour)
    for colour, share in (((0, 0, 0), 0.3), ((255, 255, 255), 0.25)):
        assert drawn.count(colour) / 2000 == pytest.approx(share, abs=0.04)
    grey = sum(len(set(colour)) == 1 for colour in drawn)
    assert grey / 2000 == pytest.approx(0.7, abs=0.04)


def test_scenes_of_solids_and_of_polygons(monkeypatch):
    for share, numbers in ((0.0, range(8, 28)), (1.0, range(1, 7))):
        monkeypatch.setattr(rendered, "SOLID", share)
        for seed in range(8):
            assert len(rendered.draw_parts(np.random.default_rng(seed), PICTURES)) in numbers
