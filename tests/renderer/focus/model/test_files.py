import numpy as np
import pytest

from ciir.errors import InvalidGeometry, InvalidOption
from ciir.renderer.focus.model import Model, encode_model
from ciir.renderer.lens_array import LensArray
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.shading import encode_srgb

LEVELS = np.arange(256, dtype=np.uint8)


@pytest.fixture
def model():
    """A fan of triangles with every level of 8 bits."""
    angle = np.linspace(0, 3, 256)
    vertices = np.stack([np.cos(angle), np.sin(angle), -2 - angle], axis=1)
    faces = np.stack([np.zeros(254, int), np.arange(1, 255), np.arange(2, 256)], axis=1).astype(np.int32)
    return Model(vertices, np.stack([LEVELS, LEVELS[::-1], LEVELS], axis=1), faces, LensArray(4, 4, 3, 3))


def read(model, suffix, **options):
    return inputs.read(Bundle.from_upload(f"model{suffix}", encode_model(model, suffix, **options)))


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".GLB"])
def test_models_come_back_with_their_colours_unlit(model, suffix):
    scene = read(model, suffix)
    (part,) = scene.parts
    assert not scene.notes
    assert part.vertices[part.faces] == pytest.approx(model.vertices[model.faces], abs=1e-6)
    colors = encode_srgb(part.colors) if part.is_linear else part.colors
    assert (np.rint(255 * colors[part.faces][..., :3]) == model.colors[model.faces]).all()


def test_points_alone_are_refused_when_they_are_read(model):
    with pytest.raises(InvalidGeometry, match="not points or lines alone"):
        read(model, ".ply", points=True)


def test_other_formats_are_refused(model):
    with pytest.raises(InvalidOption, match=r"\.glb or \.ply"):
        encode_model(model, ".obj")
    with pytest.raises(InvalidOption, match=r"give \.ply"):
        encode_model(model, ".glb", points=True)


def test_a_model_is_saved_by_its_name(model, tmp_path):
    for name in ("scene.glb", "scene.ply"):
        model.save(tmp_path / name)
        assert (tmp_path / name).read_bytes() == encode_model(model, name[-4:])
