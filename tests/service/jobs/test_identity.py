from dataclasses import replace
from hashlib import sha256

import pytest

from ciir.models import cards
from ciir.models.catalogue import SHIPPED
from ciir.service.jobs import identity
from ciir.service.jobs.job import Request

LIMITS = {"max_pixels": 10}


def compute_id(name="upload.png", data=b"data", form=None, limits=LIMITS, **options):
    return identity.compute_id(Request(name, options, form), sha256(data).hexdigest(), limits)


def test_equal_requests_have_equal_ids():
    assert compute_id() == compute_id()
    assert compute_id(lenses="50x50", views="center") == compute_id(lenses=" 50X50")
    assert len(compute_id()) == 32
    assert set(compute_id()) <= set("0123456789abcdef")


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
def test_any_difference_changes_the_id(other):
    assert compute_id(**other) != compute_id()


def test_networks_of_ones_own_are_part_of_the_id(monkeypatch, tmp_path):
    before = identity.hash_installation.__wrapped__()
    (tmp_path / "mine.onnx").write_bytes((SHIPPED / "fast.onnx").read_bytes())
    cards.write_card(replace(cards.read_card(SHIPPED / "fast.json"), name="mine"), tmp_path / "mine.json")
    monkeypatch.setenv("CIIR_MODELS", str(tmp_path))
    assert identity.hash_installation.__wrapped__() != before


def test_the_installation_is_part_of_the_id(monkeypatch):
    before = compute_id()
    monkeypatch.setattr(identity, "hash_installation", lambda: "another network")
    assert compute_id() != before
