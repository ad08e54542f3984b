import io

import pytest

from ciir.service.jobs import identity as module
from ciir.service.jobs.identity import identity
from ciir.service.jobs.job import Request

LIMITS = {"max_pixels": 10}


def of(name="upload.png", data=b"data", form=None, limits=LIMITS, **options):
    return identity(Request(name, options, form), io.BytesIO(data), limits)


def test_the_same_is_the_same():
    assert of() == of()
    assert of(lenses="50x50", views="center") == of(lenses=" 50X50")
    assert len(of()) == 32
    assert set(of()) <= set("0123456789abcdef")


@pytest.mark.parametrize(
    "other",
    [
        {"name": "upload.tif"},
        {"data": b"Data"},
        {"data": b""},
        {"form": "zip"},
        {"lenses": "50x50"},
        {"limits": {"max_pixels": 11}},
    ],
)
def test_anything_else_is_another(other):
    assert of(**other) != of()


def test_another_installation_is_another(monkeypatch):
    before = of()
    monkeypatch.setattr(module, "installation", lambda: "another network")
    assert of() != before


def test_all_of_a_long_file_counts_and_it_is_left_at_its_beginning():
    data = bytearray(3 * module.CHUNK)
    before = of(data=bytes(data))
    data[-1] = 1
    file = io.BytesIO(bytes(data))
    file.seek(5)
    assert identity(Request("upload.png", {}, None), file, LIMITS) != before
    assert file.tell() == 0


def test_an_installation_has_one_name():
    first = module.installation()
    module.installation.cache_clear()
    assert module.installation() == first
    assert len(first) == 64
