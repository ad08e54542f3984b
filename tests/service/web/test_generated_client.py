"""A client that openapi-python-client generates from the document submits, waits and fetches results of a real server.

Its configuration is that of docs/http.md.
"""

import importlib
import io
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from ciir.renderer.readers.pictures import decode
from tests.support.inputs import EIA, EIA_PNG
from tests.support.paths import ROOT
from tests.support.waiting import wait_until

(CONFIGURATION,) = re.findall(
    r"^```yaml\n(.*?)^```$", (ROOT / "docs" / "http.md").read_text(), re.DOTALL | re.MULTILINE
)


@pytest.fixture(scope="module")
def generated(server, tmp_path_factory):
    """The generated package: `api` (modules by the names of operations), `models`, `File` and a `client`."""
    folder = tmp_path_factory.mktemp("generated")
    (folder / "config.yaml").write_text(CONFIGURATION)
    command = [sys.executable, "-m", "openapi_python_client", "generate", "--url", f"{server}/openapi.json"]
    command += ["--meta", "none", "--output-path", folder / "generated_client", "--config", folder / "config.yaml"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)  # noqa: S603 - our own
    assert (done.returncode, "WARNING" in done.stdout + done.stderr) == (0, False), done.stdout + done.stderr
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        package = importlib.import_module("generated_client")
        paths = [path.relative_to(folder).with_suffix("").parts for path in folder.rglob("api/*/*.py")]
        api = {parts[-1]: importlib.import_module(".".join(parts)) for parts in paths if parts[-1] != "__init__"}
        models = importlib.import_module("generated_client.models")
        file = importlib.import_module("generated_client.types").File
        with package.Client(server, raise_on_unexpected_status=True) as client:
            yield SimpleNamespace(**api, models=models, File=file, client=client)


def make_file(generated):
    return generated.File(io.BytesIO(EIA_PNG), "eia.png", "image/png")


def test_submit_wait_fetch(generated):
    models = generated.models
    body = models.ReconstructionForm(
        file=make_file(generated), lenses="6x9", views="all", model=models.ReconstructionFormModel.NONE, scale=1,
        format_=models.ReconstructionFormFormat.NPZ,
    )  # fmt: skip
    job = generated.create_reconstruction.sync(client=generated.client, body=body, prefer="respond-async")
    assert isinstance(job, models.Reconstruction)
    wait = lambda: generated.get_reconstruction.sync(job.id, client=generated.client)  # noqa: E731
    done = wait_until(lambda: (now := wait()).state is models.ReconstructionState.DONE and now)
    assert (done.report.lens_array.rows, done.report.plan.model, done.result.format_) == (6, "none", "npz")
    result = generated.get_reconstruction_result.sync(job.id, client=generated.client)
    views = np.load(io.BytesIO(result.payload.getvalue()))["views"]
    assert np.array_equal(views[5], EIA[1::4, 1::4])
    removed = generated.delete_reconstruction.sync_detailed(job.id, client=generated.client)
    assert removed.status_code == 200


def test_the_other_kinds_and_problems(generated):
    models = generated.models
    made = generated.create_upscale.sync(client=generated.client, body=models.UpscaleForm(file=make_file(generated)))
    height, width = EIA.shape[:2]
    assert decode(made.payload.getvalue(), name="x").shape == (2 * height, 2 * width, 3)  # all options by default
    body = models.DisparityForm(file=make_file(generated), lenses="6x9")
    assert generated.create_disparity.sync(client=generated.client, body=body).payload.getvalue()[:2] == b"Pf"
    body = models.PlaneForm(file=make_file(generated), lenses="6x9", stack="-1:1:3", format_=models.PlaneFormFormat.NPY)
    planes = generated.create_plane.sync(client=generated.client, body=body).payload
    assert np.load(io.BytesIO(planes.getvalue())).shape == (3, 6, 9, 3)
    body = models.ElementalForm(file=make_file(generated))
    problem = generated.create_elemental.sync(client=generated.client, body=body)
    assert isinstance(problem, models.Problem)
    assert (problem.status, problem.title) == (422, "Invalid option")
    listed = generated.list_models.sync(client=generated.client)
    assert "fast" in {model.name for model in listed}
    assert generated.get_readiness.sync(client=generated.client).to_dict() == {"status": "ready"}
