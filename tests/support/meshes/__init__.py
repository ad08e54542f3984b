"""Reads mesh files from bytes, and holds checks that the tests of all mesh formats share."""

import tracemalloc

import numpy as np
import pytest

from ciir.errors import InputError
from ciir.renderer.limits import Limits
from ciir.renderer.readers import meshes
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.meshes.pose import AS_STORED
from ciir.renderer.readers.registry import SUFFIXES
from ciir.renderer.shading import shade

FRONT = float(shade(np.array([[0.0, 0, 1]]))[0])
"""The light on a surface that faces along +z."""
UP = float(shade(np.array([[0.0, 1, 0]]))[0])
"""The light on a surface that faces along +y."""


def read_mesh(suffix, data, beside=None, pose=AS_STORED, **limits):
    """Reads the scene of the mesh file `m/a` + `suffix`. `beside`: other files in its folder, name -> bytes."""
    main = f"m/a{suffix}"
    found = {main: data} | {f"m/{name}": content for name, content in (beside or {}).items()}
    return meshes.read(Bundle(f"a{suffix}", main, found, Limits(**limits)), main, SUFFIXES[suffix], pose=pose)


def find_area(scene):
    """Computes the area of all triangles."""
    corners = np.concatenate([part.vertices[part.faces] for part in scene.parts])
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2


def assert_refused(suffix, data, message, beside=None):
    """Checks that the file is refused with an error of one line that matches `message`."""
    with pytest.raises(InputError, match=message) as caught:
        read_mesh(suffix, data, beside)
    assert "\n" not in str(caught.value)


def assert_refused_in_little_memory(suffix, data):
    """Checks that the file, which has one very long number, is refused before its other numbers are made as long."""
    tracemalloc.start()
    assert_refused(suffix, data, ".")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20_000_000
