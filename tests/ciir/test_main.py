import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from ciir.__main__ import main

INTERRUPTED_IMPORT = """
import signal, sys
signal.signal(signal.SIGINT, signal.{handler})

class Finder:
    def find_spec(name, *_):
        if name == "ciir.service.cli.main":
            try:
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                raise ImportError("as numpy does") from None

sys.meta_path.insert(0, Finder)
from ciir.__main__ import main
sys.argv[1:] = ["--version"]
sys.exit(main())
"""


@pytest.mark.parametrize(
    ("handler", "status", "message"), [("default_int_handler", 130, "ciir: interrupted\n"), ("SIG_IGN", 0, "")]
)
def test_ctrl_c_while_modules_are_imported(handler, status, message):
    code = INTERRUPTED_IMPORT.format(handler=handler)
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)  # noqa: S603
    assert (ended.returncode, ended.stderr) == (status, message)


def test_ctrl_c_is_usual_afterwards(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["ciir", "--version"])
    before = signal.getsignal(signal.SIGINT)
    assert main() == 0
    assert capsys.readouterr().out
    assert signal.getsignal(signal.SIGINT) is before


def test_numpy_has_one_thread_for_matrices_unless_told_otherwise():
    code = (
        "import os, sys; from ciir.__main__ import main; sys.argv[1:] = ['--version']; main(); print(os.environ['{}'])"
    )
    name = "OPENBLAS_NUM_THREADS"
    without = {key: value for key, value in os.environ.items() if key != name}
    for environment, wanted in ((without, "1"), (without | {name: "3"}, "3")):
        command = [sys.executable, "-c", code.format(name)]
        ended = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)  # noqa: S603
        assert ended.stdout.split()[-1] == wanted


def test_the_installed_command_is_the_same():
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert project["scripts"]["ciir"] == f"{main.__module__}:main"
