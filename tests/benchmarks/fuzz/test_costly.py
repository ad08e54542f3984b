import contextlib

import pytest

from benchmarks.fuzz import costly
from renderer import inputs
from renderer.bundle import Bundle
from renderer.errors import InvalidGeometry, InvalidOption, TooLarge, UnsupportedType

SMALL = sorted(set(costly.CASES) - {"black", "scans"})
"""The two others are as large as pictures may be, and take seconds."""


@pytest.mark.parametrize("case", SMALL)
def test_every_case_is_what_it_says_and_is_read_or_refused(case):
    made = costly.CASES[case](30_000)
    assert 5_000 < len(made.data) < 300_000
    bundle = Bundle.from_upload(made.name, made.data)  # a file of the kind that its name says
    with contextlib.suppress(
        TooLarge, InvalidGeometry, InvalidOption, UnsupportedType
    ):  # Unreadable would be a case that is broken
        inputs.read(bundle, lenses=None, pixels=(1, 1))


def test_what_it_took_is_told(capsys):
    assert costly.main(["elements", "--mebibytes", "1"]) == 0
    line = capsys.readouterr().out
    assert line.startswith("elements  ")
    assert "1.0 MiB" in line
    assert "InvalidGeometry: a.ply: no triangles" in line


def test_what_takes_too_long_does_not_hold(monkeypatch, capsys):
    class Receiver:
        def poll(self, seconds):
            return False

    class Process:
        def __init__(self, **given):
            pass

        start = kill = join = lambda self: None

    class Context:
        def Pipe(self, duplex):  # noqa: N802 - the library's name
            return Receiver(), None

    Context.Process = Process
    monkeypatch.setattr(costly.multiprocessing, "get_context", lambda way: Context())
    assert costly.main(["elements"]) == 1
    assert "takes more than 300 s" in capsys.readouterr().out


def test_a_case_that_is_none(capsys):
    with pytest.raises(SystemExit):
        costly.main(["everything"])
    assert "everything: no such case; known are comments" in capsys.readouterr().err
