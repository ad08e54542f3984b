"""Which module may import which: held against every import in the code, lazy ones included.

Imports for type checkers alone (`if TYPE_CHECKING:`) do not count. Names are those behind `ciir.`.
"""

from __future__ import annotations

import ast
from collections import Counter
from functools import cache

import pytest

from tests.support.paths import ROOT

SERVICE = {"renderer", "models", "service", "service.pipeline"}
ARROWS = {
    "renderer": set(),
    "models": set(),
    "ciir": {"renderer", "service"},
    "ciir.__main__": {"service.cli"},
    "service": {"renderer", "models", "service.pipeline"},
    "service.pipeline": {"renderer", "models"},
    "service.jobs": SERVICE,
    "service.batch": SERVICE | {"service.jobs"},
    "service.web": SERVICE | {"service.jobs"},
    "service.demo": SERVICE | {"ciir"},
    "service.cli": SERVICE | {"ciir", "service.jobs", "service.batch", "service.web", "service.demo"},
    "service.cli.commands.bench": SERVICE | {"service.cli", "benchmarks"},
    "service.cli.commands.stress": SERVICE | {"service.cli", "benchmarks"},
    "service.cli.commands.evaluate": SERVICE | {"service.cli", "training"},
    "service.cli.commands.training": SERVICE | {"service.cli", "training"},
    "training": {"renderer", "models"},
    "benchmarks": SERVICE | {"ciir", "service.batch", "training"},
}
"""Package -> the packages that it may import besides itself and `SHARED`.

`ciir` is the Python interface, and `service` the modules in that folder, without its packages.
"""
SHARED = ("ciir.errors", "ciir.cores", "ciir.bit_depth", "ciir.model_folder")
"""Modules that every package may import."""
LIBRARIES = {
    "pyrender": {"renderer.backends.opengl"},
    "OpenGL": {"renderer.backends.opengl"},
    "embreex": {"renderer.backends.embree"},
    "onnxruntime": {"models.sessions", "training.export.export"},
    "torch": {"training", "benchmarks"},
    "onnx": {"training", "benchmarks"},
}
"""Library -> the modules, or packages, that may import it."""
FOLDERS = ("renderer", "models", "service", "training", "benchmarks")
MOST_MODULES = 12
"""In one folder, without `__init__` and `conftest`."""


def find_files():
    """Each module's name, without `ciir.` -> its file."""
    files = {("ciir", file.stem): file for file in (ROOT / "ciir").glob("*.py")}
    files |= {
        file.relative_to(ROOT).with_suffix("").parts: file for name in FOLDERS for file in (ROOT / name).rglob("*.py")
    }
    names = {".".join(parts).removesuffix(".__init__"): file for parts, file in files.items()}
    return {name.removeprefix("ciir.") if name in SHARED else name: file for name, file in names.items()}


FILES = find_files()
NAMES = {f"ciir.{name}" for name in FILES}


@cache
def read_imports(file):
    """(absolute name, whether only type checkers see it) of each import in `file`, for `from a import b` of `a.b`.

    A text that is a module's whole name counts as an import of it: `import_module` takes such texts.
    """
    found, nodes = [], [(ast.parse(file.read_text(encoding="utf-8")), False)]
    while nodes:
        node, only_types = nodes.pop()
        if isinstance(node, ast.Import):
            found += [(alias.name, only_types) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{file}: line {node.lineno} is a relative import"
            found += [(f"{node.module}.{alias.name}", only_types) for alias in node.names]
        elif isinstance(node, ast.Constant) and str(node.value) in NAMES:
            found.append((node.value, False))
        elif isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            only_types = True
        nodes += [(child, only_types) for child in ast.iter_child_nodes(node)]
    return found


def find_module(name):
    """The module of this project that the import of `name` loads, None for a library's."""
    top, _, rest = name.partition(".")
    if top != "ciir":
        return None
    while rest and rest not in FILES:
        rest = rest.rpartition(".")[0]
    return rest or "ciir"


def find_package(module):
    """The longest of ARROWS' names that holds `module`."""
    if module in ("errors", "cores", "bit_depth", "model_folder", "tests"):
        return module
    return max((name for name in ARROWS if is_inside(module, name)), key=len)


def is_inside(module, package):
    return f"{module}.".startswith(f"{package}.")


@pytest.fixture(scope="module")
def imports():
    """Module -> what it imports at run time. Not at the top: each process of xdist collects all tests."""
    return {
        module: {name for name, only_types in read_imports(file) if not only_types} for module, file in FILES.items()
    }


@pytest.fixture(scope="module")
def graph(imports):
    """Module -> the modules of this project that it imports."""
    return {
        module: {found for name in names if (found := find_module(name)) is not None and found != module}
        for module, names in imports.items()
    }


@pytest.mark.parametrize("package", ARROWS)
def test_packages_import_only_what_is_declared(graph, package):
    inside = {module: names for module, names in graph.items() if find_package(module) == package}
    assert inside
    forbidden = {
        f"{module} imports {name}"
        for module, names in inside.items()
        for name in names
        if find_package(name) not in ARROWS[package] | {package, "errors", "cores", "bit_depth", "model_folder"}
    }
    assert not forbidden


@pytest.mark.parametrize("module", SHARED)
def test_what_all_share_imports_nothing(graph, module):
    assert not graph[module.removeprefix("ciir.")]


def test_there_are_no_circles(graph):
    """A module that imports nothing, or that nothing imports, lies on no circle: without circles all can be removed."""
    left = {module: set(names) for module, names in graph.items()}
    while True:
        imported = set().union(*left.values()) if left else set()
        outside = {module for module, names in left.items() if not names or module not in imported}
        if not outside:
            break
        left = {module: names - outside for module, names in left.items() if module not in outside}
    assert not left


@pytest.mark.parametrize("library", LIBRARIES)
def test_libraries_are_imported_in_one_place(imports, library):
    modules = {module for module, names in imports.items() if any(is_inside(name, library) for name in names)}
    assert not {module for module in modules if not any(is_inside(module, name) for name in LIBRARIES[library])}


def test_everything_is_imported_as_part_of_ciir():
    files = [*FILES.values(), *(ROOT / "tests").rglob("*.py")]
    found = {f"{file}: {name}" for file in files for name, _ in read_imports(file) if name.split(".")[0] in FOLDERS}
    assert not found


def test_no_folder_holds_too_many_modules():
    scripts = (ROOT / "service" / "web" / "page").rglob("*.js")
    files = [*FILES.values(), *(ROOT / "tests").rglob("*.py"), *scripts]
    counts = Counter(str(file.parent.relative_to(ROOT)) for file in files if file.stem not in ("__init__", "conftest"))
    assert not {folder for folder, count in counts.items() if count > MOST_MODULES}
