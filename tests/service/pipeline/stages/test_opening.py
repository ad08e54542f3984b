import threading

import pytest

from ciir.errors import BadCard, InvalidImage
from ciir.models import catalogue
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
    def fail():
        raise BadCard("the network")

    monkeypatch.setattr(network, "open", fail)
    with pytest.raises(BadCard, match="the network"):
        run(eia_bundle(EIA), lenses=(6, 9), model="fast")
    assert list_threads() == []


@pytest.mark.parametrize(("model", "views"), [("fast", 2), ("none", 1)])
def test_nothing_is_opened_for_several_views_or_without_a_model(network, model, views):
    with open_session(Plan("upscale", model, 2, 1), views=views) as wait:
        wait()
        assert list_threads() == []
    assert not network.is_open


def test_an_open_session_is_not_opened_again(network):
    plan = Plan("upscale", "fast", 2, 1)
    with open_session(plan, views=1) as wait:
        wait()
    assert network.is_open
    with open_session(plan, views=1):
        assert list_threads() == []
