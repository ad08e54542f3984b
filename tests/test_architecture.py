"""Which way data flows (docs/architecture.md): held against every import in the code."""

import ast

import pytest

from tests.support.paths import ROOT

PACKAGES = ("renderer", "models", "service", "training", "benchmarks")
MAY_NOT = {
    "renderer": {"models", "service", "training", "benchmarks"},
    "models": {"renderer", "service", "training", "benchmarks"},
    "service": {"benchmarks"},
    "training": {"service", "benchmarks"},
}
DOORS = {"service/cli/commands/bench.py": "benchmarks", "service/cli/commands/stress.py": "benchmarks"}
"""Commands that open another room; nothing else of `service` knows of it."""
ONLY_IN = {
    "pyrender": "renderer/backends/opengl.py",
    "OpenGL": "renderer/backends/opengl.py",
    "embreex": "renderer/backends/embree.py",
    "onnxruntime": "models/sessions.py",
}


def imports(file):
    """(module, whether only type checkers see it) of each import in `file`."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    checked = {
        inner
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node in checked
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module, node in checked


@pytest.mark.parametrize("package", PACKAGES)
def test_data_flows_one_way(package):
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for file in files:
        place = file.relative_to(ROOT).as_posix()
        for module, only_types in imports(file):
            top = module.removeprefix("ciir.").partition(".")[0]
            if not only_types and top != DOORS.get(place):
                assert top not in MAY_NOT.get(package, ()), f"{place} imports {module}"
            if top in ONLY_IN and package != "training":
                assert place == ONLY_IN[top], f"{place} imports {module}"
            if package in {"renderer", "models", "service"}:
                assert top not in {"torch", "onnx", "onnxscript"}, f"{place} imports {module}"
