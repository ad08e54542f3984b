"""How views were sampled is found, and undone."""

import numpy as np
import pytest
from PIL import Image

from ciir.bit_depth import round_to_depth
from ciir.models.back_projection import restore_luma
from ciir.models.light_field.finishing import FALLBACK_SHARES
from ciir.models.light_field.views import upscale_views
from ciir.models.sampling import WHOLE_ROWS, Sampling, find_common_means, measure_misfit
from ciir.models.sampling import find_sampling as find
from ciir.models.single.skipping import SkipStatistics


def find_sampling(large, small):
    return find(large, small).sampling


def make_fine(height, width, channels=3, dtype=np.uint8):
    """A picture of twice that size with detail up to its finest."""
    values = np.random.default_rng(0).random((2 * height, 2 * width, channels))
    return (values * np.iinfo(dtype).max).astype(dtype)


def filter_down(fine):
    """Half as large, by bicubic interpolation with antialiasing."""
    size = (fine.shape[1] // 2, fine.shape[0] // 2)
    planes = [Image.fromarray(plane.astype(np.float32)) for plane in np.moveaxis(fine, 2, 0)]
    small = np.stack([plane.resize(size, Image.Resampling.BICUBIC) for plane in planes], axis=2)
    return np.rint(small).clip(0, np.iinfo(fine.dtype).max).astype(fine.dtype)


def average_down(fine):
    height, width, channels = fine.shape
    means = fine.reshape(height // 2, 2, width // 2, 2, channels).mean(axis=(1, 3))
    return np.rint(means).astype(fine.dtype)


@pytest.mark.parametrize(("channels", "dtype"), [(1, np.uint8), (3, np.uint8), (3, np.uint16)])
@pytest.mark.parametrize("height", [9, WHOLE_ROWS, WHOLE_ROWS + 1, 300])
def test_filter_and_means_are_distinguished(height, channels, dtype):
    fine = make_fine(height, 40, channels, dtype)
    for make_small, kind in ((filter_down, "filter"), (average_down, "means")):
        found = find_sampling(fine, make_small(fine))
        assert found[:3] == (kind, 1, 1)
        assert found.noise < 0.02  # ten times the error of rounding to whole levels


def test_points_are_not_taken_for_clean_means():
    finer = make_fine(100, 80)
    for axis in (0, 1):
        finer = ((finer.astype(np.uint16) + np.roll(finer, 1, axis)) // 2).astype(np.uint8)
    small = average_down(finer[1:-1, 1:-1])[::2, ::2]  # the middle of each 4x4 samples
    found = find_sampling(average_down(finer), small)
    assert found is None or found.gain == 0


@pytest.mark.parametrize("make_small", [filter_down, average_down])
def test_the_noisier_the_less_is_undone(make_small):
    fine = make_fine(60, 40)
    clean = make_small(fine)
    noise = np.random.default_rng(1).normal(size=clean.shape)
    found = [
        find_sampling(fine, np.clip(np.rint(clean + level * noise), 0, 255).astype(np.uint8))
        for level in (0, 2, 4, 6, 8, 10, 12, 16)
    ]
    gains, noises = zip(*((one.gain, one.noise) for one in found if one), strict=True)
    assert list(gains) == sorted(gains, reverse=True)
    assert list(noises) == sorted(noises)
    assert gains[0] == 1
    assert gains[-1] == 0


def test_differences_of_means_count_from_three_standard_errors():
    fine = make_fine(60, 40)
    noise = 2 * np.random.default_rng(1).normal(size=(60, 40, 1))
    found = find_sampling(fine, np.clip(np.rint(average_down(fine) + noise), 0, 255).astype(np.uint8))
    assert found.kind == "means"
    assert found.noise == pytest.approx(3 * 2 / 255, rel=0.1)  # of 2,000 pixels, and rounded


def test_16_bits_are_compared_with_the_same_levels_of_8():
    """What fits to the level is neither kind, and stays."""
    small = make_fine(60, 40)
    large = 257 * small.astype(np.uint16).repeat(2, axis=0).repeat(2, axis=1)
    assert find_sampling(large, small) is None
    assert np.abs(restore_luma(large, small, "means").astype(int) - large).max() <= 1  # of 65,535


def test_between_filter_and_means_the_likeness_falls_and_rises():
    fine = make_fine(60, 40)
    ends = filter_down(fine).astype(float), average_down(fine).astype(float)
    mixed = [np.rint((1 - part) * ends[0] + part * ends[1]).astype(np.uint8) for part in np.linspace(0, 1, 41)]
    found = [find_sampling(fine, small) for small in mixed]
    likeness = [one.likeness * (1 if one.kind == "means" else -1) if one else 0 for one in found]
    assert likeness == sorted(likeness)
    assert (likeness[0], likeness[-1]) == (-1, 1)
    assert 0 in likeness
    assert any(-1 < one < 0 for one in likeness)


def test_a_view_between_two_answers_is_not_sure():
    fine = make_fine(60, 40)
    ends = filter_down(fine).astype(float), average_down(fine).astype(float)
    mixed = [np.rint((1 - part) * ends[0] + part * ends[1]).astype(np.uint8) for part in np.linspace(0, 1, 81)]
    found = [find(fine, small) for small in mixed]
    assert found[0].is_sure
    assert found[-1].is_sure
    assert all(not one.is_sure for one in found if one.sampling and one.sampling.likeness < 1)
    assert any(one.is_sure for one in found if one.sampling is None)


@pytest.mark.parametrize("shape", [(2, 2), (4, 30), (30, 4), (1, 1)])
def test_a_view_that_is_all_border_is_neither(shape):
    fine = make_fine(*shape)
    assert find_sampling(fine, filter_down(fine)) is None


def test_a_flat_view_is_neither():
    flat = np.full((40, 30, 3), 77, np.uint8)
    assert find_sampling(np.full((80, 60, 3), 77, np.uint8), flat) is None
    assert find_sampling(make_fine(40, 30), flat) is None


def test_what_lies_between_the_compared_rows_is_not_seen():
    small = np.full((WHOLE_ROWS + 72, 40, 1), 65535, np.uint16)
    large = small.repeat(2, axis=0).repeat(2, axis=1)
    small[20:50], large[40:100], large[3] = 0, 0, 65000
    assert find_sampling(large, small) is None


@pytest.mark.parametrize("height", [WHOLE_ROWS, 4 * WHOLE_ROWS])
def test_both_halves_of_a_view_count(height):
    fine = make_fine(height, 40)
    for half in (slice(height // 2), slice(height // 2, None)):
        small = filter_down(fine)
        small[half] = average_down(fine)[half]
        found = find_sampling(fine, small)
        assert found is None or found.kind == "means" or found.likeness < 1


class Making:
    """A stand-in for a light-field network, which makes one picture of every view, and is certain of it."""

    scale, radius, threads = 2, 2, 1

    def __init__(self, fine, runs=1):
        self.runs = runs
        self.planes = np.moveaxis(fine, 2, 0)[np.newaxis].astype(np.float32) / 255

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        return self.planes.repeat(len(image), axis=0), np.full_like(image[:, :1], 0.3)


class Black:
    """A stand-in for a single-picture network."""

    name, scale, radius = "black", 2, 0

    def __call__(self, images):
        return np.zeros_like(images).repeat(2, axis=2).repeat(2, axis=3)


@pytest.mark.parametrize("runs", [1, 2])
def test_views_are_restored_as_they_were_sampled(monkeypatch, runs):
    monkeypatch.setattr("ciir.models.light_field.views.average_misfit", lambda made, small: 0.0)  # black never fits
    fine = make_fine(40, 30)
    every = [(v, u) for v in range(5) for u in range(6)]
    for small, kind in ((filter_down(fine), "filter"), (average_down(fine), "means")):
        for finds in (True, False):
            views = dict.fromkeys(every, small)
            made, finished = upscale_views(Making(fine, runs), Black(), views, every, (5, 6), finds_sampling=finds)
            assert all(finishing.fallback == 0 and finishing.is_restored == finds for finishing in finished)
            assert all(finishing.is_averaged == (finds and kind == "filter") for finishing in finished)
            for picture, view in zip(made, every, strict=True):
                want = fine
                if finds and kind == "filter":
                    surrounded, other = FALLBACK_SHARES[runs]
                    share = surrounded if view in {(2, 2), (2, 3)} else other
                    want = np.rint((1 - share) * fine).astype(np.uint8)
                want = restore_luma(want, small, kind) if finds else want
                np.testing.assert_allclose(picture, want, atol=2)  # the mean is rounded, of numbers in another order


class MakingTwo:
    """A stand-in for a light-field network, which makes what it is given for each view, known by its first pixel."""

    scale, radius, threads, runs = 2, 2, 1, 1

    def __init__(self, pictures):
        self.pictures = pictures
        self.made = []

    def __call__(self, image, around, rows, cols, disparities, *, cores=None):
        numbers = np.rint(255 * image[:, 0, 0, 0]).astype(int).tolist()
        self.made += numbers
        large = [np.moveaxis(self.pictures[number], 2, 0).astype(np.float32) / 255 for number in numbers]
        return np.stack(large), np.full_like(image[:, :1], 0.3)


@pytest.mark.parametrize("grid", [(5, 6), (3, 4), (7, 7)])
def test_where_a_view_leaves_it_open_the_middle_of_its_window_decides(grid):
    fine = make_fine(40, 30)
    means, filtered = average_down(fine), filter_down(fine)
    half = np.rint((means.astype(float) + filtered) / 2).astype(np.uint8)
    # The network's picture of the first view fits neither way of sampling, that of the others fits means.
    views = {(v, u): means.copy() for v in range(grid[0]) for u in range(grid[1])}
    views[0, 0] = half.copy()
    for view, small in views.items():
        small[0, 0] = 7 if view == (0, 0) else 9
    network = MakingTwo({7: fine, 9: fine})
    assert not find(fine, views[0, 0]).is_sure
    assert find(fine, views[1, 1]) == find(fine, views[2, 2])
    made, finished = upscale_views(network, Black(), views, [(0, 0)], grid, finds_sampling=True)
    assert network.made == [7, 9]
    assert [(finishing.fallback, finishing.is_averaged, finishing.is_restored) for finishing in finished] == [
        (0, False, True)
    ]
    wanted = find_sampling(fine, views[1, 1])
    kept = 257 * fine.astype(np.uint16)
    want = restore_luma(kept, views[0, 0], "means", gain=wanted.gain, noise=wanted.noise)
    np.testing.assert_array_equal(made[0], round_to_depth(want, made.dtype))


@pytest.mark.parametrize("grid", [(3, 3), (4, 5), (6, 5), (7, 7)])
def test_a_view_does_not_depend_on_which_others_are_wanted(grid):
    """Views are means, filtered, or between them, at random."""
    random = np.random.default_rng(5)
    every = list(np.ndindex(grid))
    pictures = {number: np.roll(make_fine(40, 30), number, axis=0) for number in range(len(every))}
    views, statistics = {}, SkipStatistics()
    for number, view in enumerate(every):
        means, filtered = average_down(pictures[number]).astype(float), filter_down(pictures[number])
        share = random.choice([0, 0.3, 0.5, 0.7, 1])
        views[view] = np.rint(share * means + (1 - share) * filtered).astype(np.uint8)
        views[view][0, 0] = number
    network = MakingTwo(pictures)
    made, finished = upscale_views(network, Black(), views, every, grid, finds_sampling=True, statistics=statistics)
    assert sorted(network.made) == list(range(len(every)))  # no view is upscaled twice
    assert statistics.pixels == len(every) * 40 * 30
    for number, view in enumerate(every):
        alone = SkipStatistics()
        one, how = upscale_views(network, Black(), views, [view], grid, finds_sampling=True, statistics=alone)
        np.testing.assert_array_equal(one[0], made[number])
        assert how == [finished[number]]
        assert (alone.pixels, alone.uniform) == (40 * 30, 0)
    assert len(set(finished)) > 1


def test_what_is_skipped_counts_without_the_middle_view():
    """The middle view has a background that is skipped, the wanted one has none."""
    fine = make_fine(40, 30)
    half = np.rint((average_down(fine).astype(float) + filter_down(fine)) / 2).astype(np.uint8)
    views = {(v, u): half.copy() for v in range(5) for u in range(5)}
    for small in views.values():
        small[0, 0] = 7
    views[2, 2][4:] = 0
    statistics = SkipStatistics()
    network = MakingTwo({7: fine, 0: fine})
    upscale_views(network, Black(), views, [(0, 0)], (5, 5), finds_sampling=True, statistics=statistics)
    assert len(network.made) > 1
    assert (statistics.pixels, statistics.uniform) == (40 * 30, 0)


def test_views_that_are_sure_need_no_other():
    fine = make_fine(40, 30)
    views = {(v, u): average_down(fine) for v in range(5) for u in range(5)}
    for number, small in enumerate(views.values()):
        small[0, 0] = number
    network = MakingTwo(dict.fromkeys(range(25), fine))
    upscale_views(network, Black(), views, [(0, 0), (2, 2)], (5, 5), finds_sampling=True)
    assert sorted(network.made) == [0, 12]


def test_a_misfit_in_one_part_of_a_tall_picture_counts():
    fine = make_fine(600, 40)
    small = np.rint(np.clip(filter_down(fine), 0, 255)).astype(np.uint8)
    assert measure_misfit(fine, small) < 0.01
    small[60:120] = 255 - small[60:120]
    assert measure_misfit(fine, small) > 0.02


def test_common_means_are_those_of_more_than_half():
    means = [Sampling("means", 1.0, gain, noise) for gain, noise in ((0.2, 0.03), (1.0, 0.01), (0.9, 0.02))]
    others = [None, Sampling("filter", 1.0, 1.0, 0.0)]
    assert find_common_means([*means, *others]) == Sampling("means", 1.0, 0.9, 0.02)
    assert find_common_means([*means[:2], *others]) is None
    assert find_common_means([None]) is None
