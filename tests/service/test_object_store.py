"""Inputs and results in S3: a real server and its workers with s3fs, and a store that speaks S3."""

import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from ciir.service.client import Client
from tests.containers.object_store import run_store
from tests.support.inputs import EIA
from tests.support.servers import run_server

pytestmark = pytest.mark.slow


def test_jobs_of_a_server_whose_files_are_in_s3(eia_file, tmp_path):
    with run_store() as (environment, objects):
        settings = environment | {"CIIR_FILES": "s3://bucket/ciir", "CIIR_WORKERS": "1"}
        with run_server(tmp_path / "log", **settings) as server, Client(server.url) as client:
            result = client.reconstruct(eia_file, lenses=(6, 9), views=(1, 2), model="none")
            assert np.array_equal(decode(result.content, name="x"), EIA[1::4, 2::4])
            assert result.content in [bytes(data) for data in objects.values()]
            again = client.reconstruct(eia_file, lenses=(6, 9), views=(1, 2), model="none")
            assert (again.content, set(again.timings_ms)) == (result.content, {"stored", "total"})
            kept = client.send_file(eia_file)
            assert client.send_file(eia_file) == kept
            assert client.reconstruct(kept, lenses=(6, 9), views=(1, 2), model="none").id == result.id
            view = client.reconstruct(kept, lenses=(6, 9), views=(2, 2), model="none")
            assert np.array_equal(decode(view.content, name="x"), EIA[2::4, 2::4])
            assert decode(client.upscale(view, model="nearest").content, name="x").shape == (12, 18, 3)
        assert {key.rpartition("/")[0] for key in objects} == {"bucket/ciir/results"}  # the input was removed
