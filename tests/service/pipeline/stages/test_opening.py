import threading

import numpy as np
import pytest

from ciir.errors import BadCard, InvalidImage
from ciir.models import catalogue, processor, sessions
from ciir.models.single.network import SingleImageNetwork
from ciir.service.pipeline.planning.plan import Plan
from ciir.service.pipeline.stages import view_sources
from ciir.service.pipeline.stages.opening import open_session
from tests.support.inputs import EIA
from tests.support.pipeline import eia_bundle, run


@pytest.fixture
def network(monkeypatch):
    """A network without a session, in place of `fast`."""
    fresh = SingleImageNetwork(catalogue.SHIPPED / "fast.json")
    monkeypatch.setattr(catalogue, "load_upscaler", lambda name, scale=2: fresh)
    return fresh


def list_threads():
    return [thread for thread in threading.enumerate() if thread.name.startswith("open")]


def test_the_session_is_opened_while_the_first_view_is_made(network, monkeypatch):
    is_open, made = threading.Event(), []
    monkeypatch.setattr(network, "_get_session", lambda cores: is_open.set())

    def take(self, pictures, count):
        made.append(is_open.wait(60))
        raise InvalidImage("the view")

    monkeypatch.setattr(view_sources.LightFieldViews, "take_views", take)
    with pytest.raises(InvalidImage, match="the view"):
        run(eia_bundle(EIA), lenses=(6, 9), model="fast")
    assert made == [True]
    assert list_threads() == []


def test_an_error_in_the_thread_is_raised_and_the_thread_ends(network, monkeypatch):
    def fail(cores):
        raise BadCard("the network")

    monkeypatch.setattr(network, "open", fail)
    with pytest.raises(BadCard, match="the network"):
        run(eia_bundle(EIA), lenses=(6, 9), model="fast")
    assert list_threads() == []


@pytest.mark.parametrize(("model", "views"), [("fast", 2), ("none", 1)])
def test_nothing_is_opened_for_several_views_or_without_a_model(network, model, views):
    with open_session(Plan("upscale", model, 2, 1), views=views, pixels=100) as wait:
        wait()
        assert list_threads() == []


@pytest.mark.skipif(processor.int8_unsupported_reason() != "", reason=processor.int8_unsupported_reason())
@pytest.mark.parametrize(("side", "cores"), [(40, 3), (700, 1)])
def test_only_the_session_that_the_view_needs_is_opened(monkeypatch, side, cores):
    """A large view of an int8 network goes in tiles, each on one core."""
    network, opened = SingleImageNetwork(catalogue.SHIPPED / "fast-int8.json", threads=3), []
    monkeypatch.setattr(catalogue, "load_upscaler", lambda name, scale=2: network)
    open_it = sessions.open_session
    monkeypatch.setattr(
        sessions, "open_session", lambda data, threads, **kind: opened.append(threads) or open_it(data, threads, **kind)
    )
    with open_session(Plan("upscale", "fast-int8", 2, 1), views=1, pixels=side * side) as wait:
        wait()
    network(np.zeros((1, 3, side, side), np.float32))
    assert opened == [cores]
