"""The larger light-field generator: a blend of the light one and a single-picture one."""

import pytest

pytest.importorskip("torch", reason="needs the training extra")
import torch

from ciir.models import catalogue
from ciir.models.light_field.windows import select_axis
from ciir.training.loop.initial import load_onnx_weights
from ciir.training.networks.collapsible import collapse
from ciir.training.networks.light_field import LightFieldGenerator, fold_factors, merge_layers, split_layers
from ciir.training.networks.light_field_blend import BLENDING, BlendedGenerator

SMALL = {"widths": (8, 8), "width": 8, "depth": 1, "beside": (8, 8), "mixing": (8,)}
WHOLE = torch.from_numpy(select_axis(2, 5).present)


def draw_views(seed=4, height=9, width=7):
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(1, 3, height, width, generator=generator), torch.rand(1, 25, height, width, generator=generator)


@torch.no_grad()
def test_without_its_correction_it_is_the_mean_of_the_networks_that_it_starts_from():
    torch.manual_seed(0)
    network, light = BlendedGenerator(), LightFieldGenerator(guard=True)
    load_onnx_weights(network, catalogue.SHIPPED / "field.onnx", skipped=BLENDING)
    load_onnx_weights(network.beside, catalogue.SHIPPED / "quality.onnx")
    load_onnx_weights(light, catalogue.SHIPPED / "field.onnx")
    network.blend.widen.zero_()
    network.blend.kernel.zero_()
    image, around = draw_views(height=24, width=20)
    made = network(image, around, WHOLE, WHOLE)
    mean = (light(image, around, WHOLE, WHOLE) + network.beside(image)) / 2
    # The mean of two limited changes is within the wider of their bounds, so limiting it again leaves rounding alone.
    torch.testing.assert_close(made, mean, atol=1e-5, rtol=0)


def test_the_single_picture_generator_is_not_trained():
    network = BlendedGenerator(**SMALL)
    network(*draw_views(), WHOLE, WHOLE).mean().backward()
    kernels = {name: weight for name, weight in network.named_parameters() if name.endswith(".kernel")}
    missing = {name.partition(".")[0] for name, weight in kernels.items() if weight.grad is None}
    assert missing == {"beside"}


@torch.no_grad()
def test_grey_stays_grey_and_flat_stays_flat():
    torch.manual_seed(1)
    network = BlendedGenerator(**SMALL)
    for name, weight in network.named_parameters():
        if name.endswith((".kernel", ".bias")):
            weight.add_(0.2 * torch.randn_like(weight))
    image, around = draw_views()
    grey = network(image[:, :1].expand(-1, 3, -1, -1), around, WHOLE, WHOLE)
    assert (grey.amax(1) - grey.amin(1)).max() < 1e-5
    flat = network(torch.full((1, 3, 9, 9), 0.3), torch.full((1, 25, 9, 9), 0.3), WHOLE, WHOLE)
    torch.testing.assert_close(flat, torch.full((1, 3, 18, 18), 0.3), atol=1e-5, rtol=0)


@pytest.mark.parametrize("change", [merge_layers, split_layers])
def test_a_merged_or_split_network_computes_the_same(change):
    torch.manual_seed(2)
    network = BlendedGenerator(**SMALL)
    plain = collapse(network)
    fold_factors(plain)
    change(plain)
    views = draw_views()
    torch.testing.assert_close(plain(*views, WHOLE, WHOLE), network(*views, WHOLE, WHOLE), atol=1e-5, rtol=0)
