import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch
from torch import nn

from ciir.models.cards import Sizes
from ciir.models.light_field.planes import REACH
from ciir.training.export import inputs as examples
from ciir.training.export import measure
from ciir.training.networks import LiteGenerator, make_network
from ciir.training.networks.collapsible import collapse
from ciir.training.networks.interpolation import separate
from ciir.training.networks.light_field import LightFieldGenerator


def test_radius_and_cost_of_the_papers_generator():
    network = LiteGenerator()
    assert measure.find_receptive_radius(network, 2) == 15
    in_low = 3 * 64 * 9 + 13 * 64 * 64 * 9
    in_high = 64 * 64 * 9 + 64 * 3 * 9
    assert measure.count_macs(network, Sizes()) == in_low / 4 + in_high
    assert measure.count_parameters(network) == 520515


def test_an_interpolated_base_counts_as_work_but_not_as_parameters():
    network = collapse(make_network("compact", {"widths": [32, 48]}))
    convolutions = 9 * (3 * 32 + 32 * 48 + 48 * 12)
    assert measure.count_parameters(network) == convolutions + 32 + 48 + 12
    assert measure.count_macs(network, Sizes()) == (convolutions + 12 * 25) / 4
    assert measure.find_receptive_radius(network, 2) == 3
    network = separate(network)
    assert measure.count_parameters(network) == convolutions + 32 + 48 + 12
    assert measure.count_macs(network, Sizes()) == (convolutions + 6 * 5 * 36 / 32 + 12 * 5) / 4  # with padding


class Wide(nn.Module):
    """Nearest x2 plus a share of pixels `far` away."""

    def __init__(self, far: int, weight: float) -> None:
        super().__init__()
        self.far = nn.Conv2d(3, 3, (2 * far + 1, 1), padding=(far, 0), groups=3, bias=False)
        with torch.no_grad():
            self.far.weight.zero_()
            self.far.weight[:, :, 0] = weight

    def forward(self, image):
        return nn.functional.interpolate(image + self.far(image), scale_factor=2.0)


@pytest.mark.parametrize(("far", "radius"), [(1, 1), (40, 40), (120, 120), (121, None)])
def test_radius_of_a_kernel_along_one_axis(far, radius):
    assert measure.find_receptive_radius(Wide(far, 1.0), 2) == radius


@pytest.mark.parametrize(("far", "weight", "overlaps"), [(20, 0.5, (24, 20)), (200, 1e-3, (8, 10)), (3, 0.5, (8, 10))])
def test_tile_overlap(far, weight, overlaps):
    for step, overlap in zip((1, 5), overlaps, strict=True):
        assert measure.find_tile_overlap(Wide(far, weight), 2, Sizes(multiple_of=step)) == overlap


def test_a_network_with_a_global_mean_is_refused():
    """In even noise each tile's mean is the picture's."""

    class Gate(nn.Module):
        def forward(self, image):
            return nn.functional.interpolate(image * (0.5 + image.mean((2, 3), keepdim=True)), scale_factor=2.0)

    with pytest.raises(ValueError, match="its receptive field is larger"):
        measure.find_tile_overlap(Gate(), 2, Sizes())


def test_radius_and_cost_of_a_light_field_network():
    """Sweep, layers that compare and choose, one that informs, and what is left of the single-picture network."""
    shipped = LightFieldGenerator()
    assert measure.find_receptive_radius(shipped, 2) == REACH + 4 + 1 + 1 + 5 + 1
    assert measure.count_macs(collapse(shipped), Sizes()) * 25 * 64**2 <= 10e9  # 20 GFLOPs for 5x5 of 32x32


@pytest.mark.parametrize("place", examples.WINDOWS)
def test_the_radius_of_a_light_field_network_is_exact(place):
    """The outputs of the middle pixel against every pixel beyond the radius, and against those at its end: of a window
    in which all views are near, the filters of the examples' disparities reach less far.
    """
    torch.manual_seed(2)
    network = collapse(LightFieldGenerator(widths=(8, 16, 8), width=16, depth=1)).double()
    radius = measure.find_receptive_radius(network, 2)
    assert radius == REACH + 2 + 1 + 1 + 1 + 1
    side, middle = 2 * radius + 11, radius + 5
    inputs = [part.double() for part in examples.make_examples(network, 1, side, side, place=place)]
    rows, cols = torch.meshgrid(torch.arange(side), torch.arange(side), indexing="ij")
    far = torch.maximum((rows - middle).abs(), (cols - middle).abs())

    def change(where):
        changed = [*(torch.where(where, 1 - part, part) for part in inputs[:2]), *inputs[2:]]
        with torch.no_grad():
            difference = (network(*changed) - network(*inputs)).abs()
        return difference[..., 2 * middle : 2 * middle + 2, 2 * middle : 2 * middle + 2].max()

    assert change(far > radius) == 0
    used = inputs[2].shape[-1] // 2
    assert (used == REACH) == (place == examples.WINDOWS[1])
    assert change(far == radius - REACH + used) > 0
