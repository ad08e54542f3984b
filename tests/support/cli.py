"""Calls the command line from tests."""

from pathlib import Path

from ciir.renderer.readers.pictures import decode
from ciir.service.cli.main import main

SMALL = ["--lenses", "12x10", "--pixels", "3x5", "--backend", "raytrace"]


def fails(capsys, *argv):
    """Runs a command that must end with 2, and returns its only line on standard error."""
    assert main([str(word) for word in argv]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("ciir: ")
    assert captured.err.count("\n") == 1
    return captured.err


def read(path):
    """Reads the pixels of a picture that a command wrote."""
    return decode(Path(path).read_bytes(), name=str(path))
