"""The command line as tests call it."""

from pathlib import Path

from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main

SMALL = ["--lenses", "12x10", "--pixels", "3x5", "--backend", "raytrace"]


def fails(capsys, *argv):
    """The one line on standard error of a command that ends with 2."""
    assert main([str(word) for word in argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("ciir: ")
    assert captured.err.count("\n") == 1
    return captured.err


def read(path):
    """The pixels of a picture that a command wrote."""
    return decode(Path(path).read_bytes(), name=str(path))
