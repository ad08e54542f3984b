"""Each case of the networks holds for a correct network and breaks for a wrong one."""

import numpy as np
import pytest

from ciir.benchmarks.stress.case import Effort, Skipped
from ciir.benchmarks.stress.networks import (
    cliffs,
    gain,
    invariance,
    layers,
    patterns,
    rounds,
    shipped,
    signals,
    sizes,
)
from ciir.models import catalogue
from ciir.models.single.interpolation import Bicubic, Nearest

QUICK = Effort(("fast",), quick=True)


@pytest.fixture(autouse=True)
def no_scenes(monkeypatch):
    """Rendering the shipped scenes takes seconds, and what they show is not the point here."""
    monkeypatch.setattr(patterns, "render_views", lambda side: {"view": patterns.make_natural(side, side, seed=9)})


@pytest.fixture
def put(monkeypatch):
    """Puts a function in place of every network."""

    class Model(Nearest):
        def __init__(self, compute):
            super().__init__(2)
            object.__setattr__(self, "compute", compute)

        def __call__(self, images):
            return np.clip(self.compute(images), 0, 1)

    def replace(compute):
        monkeypatch.setattr(shipped, "load_network", lambda name, threads=None: compute)
        load = catalogue.load_upscaler
        monkeypatch.setattr(
            catalogue, "load_upscaler", lambda name, **more: load(name) if name == "bicubic" else Model(compute)
        )

    return replace


def nearest(images):
    return images.repeat(2, axis=2).repeat(2, axis=3)


def states(case, effort=QUICK):
    return [found.holds for found in case(effort)]


def test_a_difference_from_the_reference_breaks(monkeypatch):
    pytest.importorskip("onnx", reason="needs the training extra")
    cases = (signals.against_reference, signals.outside_the_range, sizes.against_reference)
    monkeypatch.setattr(sizes, "QUICK", ((1, 2), (5, 7)))
    assert [states(case) for case in cases] == [[True]] * 3
    load = shipped.load_network

    def load_inexact(name, threads=None):
        def run(images):
            result = load(name)(images)
            result[0, 1, 0, 1] += 2e-3
            return result

        return run

    monkeypatch.setattr(shipped, "load_network", load_inexact)
    assert [states(case) for case in cases] == [[False]] * 3
    (found,) = signals.against_reference(QUICK)
    assert found.where == "view"


def test_without_onnx_cases_are_skipped(monkeypatch):
    monkeypatch.setattr("ciir.benchmarks.stress.case.find_spec", lambda name: None)
    for case in (signals.against_reference, signals.outside_the_range, sizes.against_reference, *layers.CASES):
        (skipped,) = case(QUICK)
        assert isinstance(skipped, Skipped)
        assert "pip install '.[training]'" in skipped.why


def test_int8_that_is_not_its_twin_breaks(monkeypatch):
    monkeypatch.setattr(shipped, "list_int8_twins", lambda effort: [("float", "int8")])
    plain = Bicubic(2)
    for coarse, holds in (
        (lambda x: np.round(plain(x) * 128) / 128, [True, True, True]),
        (lambda x: plain(x) + 3 / 255, [False, True, False]),
    ):
        by_name = {"float": plain, "int8": coarse}
        monkeypatch.setattr(shipped, "load_network", by_name.__getitem__)
        assert states(signals.against_float) == holds
    by_name["int8"] = Nearest(2)
    monkeypatch.setattr(catalogue, "load_upscaler", by_name.__getitem__)
    assert states(sizes.against_float) == [False]


def test_flat_pictures(put):
    put(nearest)
    assert states(sizes.flat) == [True, True]
    put(lambda images: np.pad(nearest(images)[:, :, 1:, :], ((0, 0), (0, 0), (1, 0), (0, 0))))  # a black frame
    assert states(sizes.flat) == [True, False]
    put(lambda images: images)
    assert states(sizes.flat)[0] is False


def test_growth_of_activations(monkeypatch):
    pytest.importorskip("onnx", reason="needs the training extra")
    assert states(layers.activations) == [True, True]
    monkeypatch.setattr(layers, "FLOAT16", 64.0)
    assert states(layers.activations)[0] is False


def test_saturation(monkeypatch):
    pytest.importorskip("onnx", reason="needs the training extra")
    effort = Effort(("fast-int8",), quick=True)
    assert states(layers.saturation, effort) == [True, True]
    inside = shipped.expose_tensors

    def saturated(weights, names, **more):
        run = inside(weights, names, **more)

        def ran(images):
            return {name: np.full_like(values, 255) if values.ndim else values for name, values in run(images).items()}

        return ran

    monkeypatch.setattr(shipped, "expose_tensors", saturated)
    assert states(layers.saturation, effort) == [False, False]


def test_gain(put):
    put(nearest)
    for case in (gain.noise, gain.worst_direction):
        (found,) = case(QUICK)
        assert found.holds
        assert found.measured == pytest.approx(1, rel=1e-3)
    put(lambda images: 40 * nearest(images))
    for case in (gain.noise, gain.worst_direction):
        (found,) = case(QUICK)
        assert not found.holds
        assert found.measured == pytest.approx(40, rel=1e-2)


def test_shifts_symmetries_and_order(put):
    put(nearest)
    for case in (invariance.shifts, invariance.symmetries, invariance.order, invariance.threads, invariance.tile_sizes):
        assert all(states(case)), case.__name__

    def depends_on_place(images):
        return nearest(images) * np.linspace(1, 1.01, 2 * images.shape[3], dtype=np.float32)

    put(depends_on_place)
    assert states(invariance.shifts) == [True, False]
    assert states(invariance.tile_sizes) == [False]
    put(lambda images: np.roll(nearest(images), 3, axis=3))
    assert states(invariance.symmetries) == [False]
    random = np.random.default_rng(0)
    put(lambda images: nearest(images) + np.float32(1e-7) * random.random())
    assert states(invariance.order) == [False, False]


def test_threads_that_matter(monkeypatch):
    def load_network(name, threads=None):
        return lambda images: nearest(images) * np.float32(1 + 1e-4 * threads)

    monkeypatch.setattr(shipped, "load_network", load_network)
    assert states(invariance.threads) == [False]


def test_rounds(put, monkeypatch):
    monkeypatch.setattr(rounds, "DRIFT_KNOWN", {})
    put(nearest)
    assert states(rounds.rounds) == [True, True]
    put(lambda images: nearest(images) + np.float32(1.5 / 255))
    assert states(rounds.rounds) == [False, True]

    def sharpens(images):
        return nearest(np.float32(1.6) * images - np.float32(0.6) * np.roll(images, 1, axis=3))

    put(sharpens)
    faint = patterns.make_patterns(rounds.SIDE, rounds.SIDE)["faint noise"]
    monkeypatch.setattr(patterns, "make_pictures", lambda side: {"faint noise": faint})
    assert states(rounds.rounds)[1] is False


@pytest.mark.parametrize("case", cliffs.CASES, ids=lambda case: case.__name__)
def test_cliffs(case, put):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    put(Bicubic(2))
    assert states(case) == [True, True]
    assert [found.measured for found in case(QUICK)] == [0, 0]


def test_a_cliff_shows(put):
    pytest.importorskip("skimage", reason="needs scikit-image, of the bench and training extras")
    bicubic = Bicubic(2)

    def gives_up_on_dark(images):
        dark = images.mean(axis=(1, 2, 3), keepdims=True) < 0.1
        return np.where(dark, 0, bicubic(images))

    put(gives_up_on_dark)
    assert states(cliffs.brightness) == [False, False]
    put(lambda images: 0 * bicubic(images))
    assert states(cliffs.noise)[0] is False
