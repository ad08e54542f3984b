"""The limit on what generators add to interpolation."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.training.networks.compact import CompactGenerator
from ciir.training.networks.guard import limit_change


def noise(*shape, seed=0):
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def make_change(scale=1.0):
    return (noise(2, 12, 9, 8, seed=1) - 0.5) * scale


@pytest.fixture
def generator():
    """One whose weights are as far from zero as a trained one's."""
    torch.manual_seed(0)
    network = CompactGenerator((8, 8), guard=True)
    with torch.no_grad():
        for weight in network.parameters():
            if weight.requires_grad:
                weight.add_(0.2 * torch.randn_like(weight))
    return network


def test_nothing_is_added_to_a_flat_picture():
    colour = noise(2, 3, 1, 1).expand(-1, -1, 9, 8)
    assert not limit_change(make_change(), colour).any()


def test_a_flat_picture_stays_exactly_so(generator):
    colour = noise(2, 3, 1, 1).expand(-1, -1, 9, 8)
    wanted = torch.nn.functional.pixel_shuffle(generator.base(colour), 2)
    assert torch.equal(generator(colour), wanted)
    torch.testing.assert_close(wanted, noise(2, 3, 1, 1).expand_as(wanted), atol=1e-6, rtol=0)
    generator.guard = False
    assert (generator(colour) - wanted).abs().max() > 0.1


def test_a_grey_picture_stays_grey(generator):
    grey = noise(2, 1, 9, 8).expand(-1, 3, -1, -1)
    red, green, blue = limit_change(make_change(), grey).chunk(3, 1)
    assert torch.equal(red, green)
    assert torch.equal(green, blue)
    assert red.abs().max() > 0.1
    red, green, blue = generator(grey.contiguous()).chunk(3, 1)
    assert torch.equal(red, green)
    assert torch.equal(green, blue)
    generator.guard = False
    assert (generator(grey)[:, 0] - generator(grey)[:, 1]).abs().max() > 0.1


def test_a_change_within_the_room_is_kept():
    """Each 3x3 neighbourhood holds black and saturated red, so differences of up to 1 are allowed."""
    image = torch.zeros(2, 3, 9, 8)
    image[:, 0, ::2] = 1
    torch.testing.assert_close(limit_change(make_change(), image), make_change(), atol=1e-6, rtol=0)


def test_a_change_is_clamped_to_the_contrast_around():
    """Grey 0.4 left of an edge, 0.5 right of it: 0.1 is the most next to it, and nothing two pixels away."""
    image = torch.full((1, 3, 6, 8), 0.4)
    image[..., 4:] = 0.5
    limited = limit_change(torch.full((1, 12, 6, 8), -0.3), image)
    wanted = torch.zeros(8)
    wanted[3:5] = -0.1
    torch.testing.assert_close(limited, wanted.expand(1, 12, 6, 8))


def test_colours_differ_by_no_more_than_around():
    """A change of red only, in a picture whose colours differ by 0.06: the mean may change as the contrast lets it."""
    image = torch.zeros(1, 3, 6, 6)
    image[..., ::2] = 0.6
    image[:, 0] += 0.06
    change = torch.zeros(1, 12, 6, 6)
    change[:, :4] = 0.3
    red, green, blue = limit_change(change, image).chunk(3, 1)
    torch.testing.assert_close(red, torch.full((1, 4, 6, 6), 0.16))  # a mean of 0.1, and 0.06 of the 0.2 beyond
    torch.testing.assert_close(green, torch.full((1, 4, 6, 6), 0.04))
    assert torch.equal(green, blue)


def test_what_other_views_hold_is_more_room():
    grey = torch.full((1, 3, 6, 6), 0.5)
    more = torch.zeros(1, 1, 6, 6)
    more[..., 2] = 0.2
    limited = limit_change(torch.full((1, 12, 6, 6), 0.3), grey, more)
    torch.testing.assert_close(limited, more.expand(1, 12, 6, 6))
