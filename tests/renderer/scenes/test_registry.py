import numpy as np
import pytest

from ciir.errors import InvalidOption
from ciir.renderer.placement import Placement
from ciir.renderer.scenes import SCENES, load_scene, registry
from ciir.renderer.shading import normalize, shade
from ciir.renderer.surface import assemble_scene


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_is_clean_and_of_moderate_size(name: str) -> None:
    made = load_scene(name)
    assert made.notes == ()  # no triangle of zero area, nothing else left out
    assert 10_000 < made.triangles < 60_000
    assert made.bounds().shape == (2, 3)
    extent = np.ptp(made.bounds(), axis=0)
    assert 1 < extent.min() <= extent.max() < 4
    assert load_scene(name) is made


@pytest.mark.parametrize("name", SCENES)
def test_scenes_are_the_same_each_time(name: str) -> None:
    again = assemble_scene(SCENES[name](), name=name)
    for one, other in zip(load_scene(name).parts, again.parts, strict=True):
        assert np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.faces, other.faces)
        assert np.array_equal(one.colors, other.colors)
        assert (one.texture is None) == (other.texture is None)
        if one.texture and other.texture:
            assert np.array_equal(one.texture.pixels, other.texture.pixels)


def test_scenes_rise_in_complexity() -> None:
    assert list(SCENES) == ["vase", "globe", "hamburger"]
    vase, globe, hamburger = (load_scene(name) for name in SCENES)
    assert [part.texture for part in vase.parts] == [None]
    assert np.abs(np.diff(globe.parts[0].texture.pixels[:, :, :3].astype(int), axis=1)).mean() > 5
    assert len(hamburger.parts) > len(globe.parts) > len(vase.parts)
    assert any(part.texture for part in hamburger.parts)
    assert any(part.texture is None and np.ptp(part.colors[:, 1]) > 0.5 for part in hamburger.parts)


def test_the_vase_is_one_closed_surface_lit_from_outside() -> None:
    (part,) = load_scene("vase").parts
    corners = part.vertices[part.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.einsum("mi,mi->m", corners[:, 0], normals).sum() > 0  # its volume: outside is out
    assert np.abs(normals.sum(axis=0)).max() < 1e-9  # closed
    expected = 0.45 * shade(normalize(normals))
    assert np.abs(part.colors[part.faces][:, :, 0].mean(axis=1) - expected).mean() < 0.01


def test_unknown_scene() -> None:
    with pytest.raises(InvalidOption, match="scene:teapot: no such scene; the scenes are vase, globe, hamburger"):
        load_scene("teapot")


def test_a_turned_scene_is_lit_anew_but_not_made_again(monkeypatch):
    upright = load_scene("vase")
    monkeypatch.setitem(SCENES, "vase", None)  # can't be called
    turned = load_scene("vase", Placement(rotate=(20, 30, 0)))
    assert turned is not upright
    assert not np.array_equal(turned.parts[0].colors, upright.parts[0].colors)
    again = load_scene("vase")
    for one, other in zip(again.parts, assemble_scene(registry.vase.make_surfaces(), name="vase").parts, strict=True):
        assert np.array_equal(one.colors, other.colors)  # what is kept has not changed
