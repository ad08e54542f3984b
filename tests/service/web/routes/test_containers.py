"""Light fields in other formats over HTTP, in worker processes with their restrictions."""

import io

import numpy as np
import pytest
import scipy.io

from ciir.renderer.light_field import LightField
from tests.support.inputs import EIA

FIELD = LightField.from_eia(EIA, rows=6, cols=9)
WHOLE = {"views": "all", "model": "none"}


def post(client, name, data, **fields):
    return client.post("/v1/reconstructions", files={"file": (name, data)}, data=WHOLE | fields)


def test_one_format_after_the_other(client, eia):
    """From an elemental image array through a MAT file and a TIFF stack to an array: the same views."""
    mat = post(client, "eia.png", eia, lenses="6x9", format="mat")
    assert mat.headers["content-disposition"].endswith('.mat"')
    stored = scipy.io.loadmat(io.BytesIO(mat.content))["LF"]
    np.testing.assert_array_equal(stored, FIELD.with_depth_sense("cameras").views)
    stack = post(client, "a.mat", mat.content, format="stack", order="given")
    array = post(client, "a.tif", stack.content, format="npy", order="given")
    np.testing.assert_array_equal(np.load(io.BytesIO(array.content)), stored)


@pytest.mark.parametrize("name", ["mat73", "hci", "mp4", "webm", "gif"])
def test_libraries_work_within_the_restrictions(client, eia, name):
    fields = {} if name in {"mat73", "hci"} else {"frames": "4", "path": "sweep"}
    made = post(client, "eia.png", eia, lenses="6x9", format=name, **fields)
    assert made.status_code == 200
    suffix = made.headers["content-disposition"].rpartition(".")[2].strip('"')
    again = post(client, f"a.{suffix}", made.content, format="npy", order="given")
    assert again.status_code == 200
    views = np.load(io.BytesIO(again.content))
    assert views.shape[:2] == ((4, 4) if name in {"mat73", "hci"} else (1, 4))


def test_a_part_of_the_views_is_refused(client, eia):
    refused = client.post(
        "/v1/reconstructions", files={"file": ("eia.png", eia)}, data={"lenses": "6x9", "format": "mat"}
    )
    assert refused.status_code == 422
    assert "give views all" in refused.json()["detail"]


def test_lenses_that_are_not_those_of_the_file_are_refused(client):
    file = io.BytesIO()
    scipy.io.savemat(file, {"LF": FIELD.views})
    refused = post(client, "a.mat", file.getvalue(), lenses="3x3")
    assert refused.status_code == 422
    assert "lenses: 3x3 doesn't fit upload.mat, whose views have 6x9 pixels; leave it out" in refused.json()["detail"]
