"""Rendering backends, and scenes in front of a lens array for them."""

import pytest

from ciir.errors import BackendUnavailable
from ciir.renderer.backends import Backend, open_backend
from ciir.renderer.framing import frame_scene
from ciir.renderer.lens_array import LensArray
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.inputs import read
from ciir.renderer.scene import Scene
from ciir.renderer.scenes import SCENES, load_scene
from tests.support.paths import SHARED

BACKENDS = ["raster", "raytrace"]
ARRAY = LensArray(50, 50, 15, 15)


def require_backend(name: str) -> Backend:
    """The backend called `name`; skips the test where it doesn't run."""
    try:
        return open_backend(name)[0]
    except BackendUnavailable as error:
        pytest.skip(str(error))


def place_scene(name: str, array: LensArray = ARRAY) -> Scene:
    """A sample scene, or a mesh file of ../shared, in front of `array`; skips the test without ../shared."""
    if name in SCENES:
        found = load_scene(name)
    elif SHARED.is_dir():
        found = read(Bundle.from_path(SHARED / "data" / "meshes" / name))
        assert isinstance(found, Scene)
    else:
        pytest.skip("needs ../shared")
    return found.transform(frame_scene(found, array))
