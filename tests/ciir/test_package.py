import importlib.metadata
import json
import subprocess
import sys

import ciir


def test_names_are_there_and_listed():
    assert dir(ciir) == sorted(ciir.__all__)
    assert all(getattr(ciir, name) is not None for name in ciir.__all__)
    assert not hasattr(ciir, "colour")


def test_an_import_loads_nothing_heavy():
    code = "import ciir, sys, json; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert not {"numpy", "PIL", "onnxruntime", "OpenGL", "trimesh"} & set(json.loads(done.stdout))


def test_all_errors_are_one_tree():
    for name in ("BackendUnavailable", "InputError", "InvalidGeometry", "InvalidOption", "ModelError", "TooLarge"):
        assert issubclass(getattr(ciir, name), ciir.Error)


def test_the_version_is_that_of_the_installation():
    assert ciir.__version__ == importlib.metadata.version("ciir")
