import errno
import resource
from contextlib import contextmanager

import pytest

from ciir.training import atomic_write


@contextmanager
def full_disk():
    """No file may grow beyond 1000 bytes: what is left of a disk that is all but full.

    For as short as can be: the tests' own log is a file too.
    """
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_file_takes_the_place_of_another(tmp_path):
    path = tmp_path / "a.csv"
    path.write_bytes(b"old")
    (tmp_path / "a.csv.partial").write_bytes(b"of a run that was killed")
    atomic_write.write(path, b"new")
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_what_was_there_survives_a_full_disk(tmp_path):
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(b"old")
    with pytest.raises(OSError, match=r"checkpoint\.pt") as caught, full_disk():
        atomic_write.write(path, bytes(5000))
    assert (caught.value.errno, caught.value.filename) == (errno.EFBIG, str(path))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
