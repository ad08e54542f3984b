"""Light fields that are rendered before training."""

import itertools
from collections import Counter

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from PIL import Image

from ciir.training.data import mesh_views
from ciir.training.data.light_field import rendered_fields
from ciir.training.data.light_field.rendered_fields import OWN, draw_own, render_fields
from ciir.training.data.light_field.textures import TEXTURE, Textures
from ciir.training.data.pictures import Pictures

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture(scope="module")
def textures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("textures")
    pixels = np.random.default_rng(0).integers(0, 256, (TEXTURE, TEXTURE + 8, 3), np.uint8)
    Image.fromarray(pixels).save(folder / "a.png")
    return Textures(Pictures(folder), torch.device("cpu"))


@pytest.fixture
def mesh(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_views, "PICTURES", 1)
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    return tmp_path / "a.obj"


def list_parts(field):
    return [*field.views.values(), *field.colours.values(), field.high]


def test_fields_do_not_depend_on_the_number_of_processes(mesh, textures, monkeypatch):
    made = []
    for count in (1, 2):
        monkeypatch.setattr(rendered_fields, "count_available_cores", lambda count=count: count)
        made.append(render_fields([mesh], 3, textures, 5, 16))
    assert [len(fields) for fields in made] == [4, 4]
    for one, same in zip(*made, strict=True):
        assert all(torch.equal(a, b) for a, b in zip(list_parts(one), list_parts(same), strict=True))
        assert (one.own, one.disparities) == (same.own, same.disparities)
    assert len({field.high.numpy().tobytes() for field in made[0]}) == 4


def test_a_field_is_the_window_of_its_number(mesh, textures):
    (field,) = render_fields([mesh], 0, textures, 5, 16)
    own = draw_own(np.random.default_rng((5, 0, 4)))
    wanted = mesh_views.render_window(mesh_views.read_mesh(mesh), seed=5, index=0, own=own)
    assert all(torch.equal(a, b) for a, b in zip(list_parts(field), list_parts(wanted), strict=True))
    assert (field.own, field.disparities) == (own, wanted.disparities)


def test_fields_smaller_than_the_crop_are_left_out(textures, capsys):
    fields = render_fields([], 2, textures, 5, 64)
    assert [tuple(field.high.shape) for field in fields] == [(3, 192, 192)]
    assert "1 of 2 light fields of meshes are left out: they are smaller than the crop of 128x128" in (
        capsys.readouterr().err
    )


def test_without_meshes_and_scenes_nothing_is_rendered(textures, capsys):
    assert render_fields([], 0, textures, 5, 16) == []
    assert capsys.readouterr().err == ""


def test_the_view_is_anywhere_in_its_window():
    """Near the middle more often; the other half of the places comes by flips."""
    random = np.random.default_rng(0)
    drawn = Counter(draw_own(random) for _ in range(4000))
    assert set(drawn) == set(itertools.product(range(3), repeat=2))
    shares = dict(OWN)
    for (row, col), number in drawn.items():
        assert number / 4000 == pytest.approx(shares[row] * shares[col], abs=0.025)
