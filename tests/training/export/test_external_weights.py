import hashlib
import sys

import numpy as np
import pytest

NEEDS = "needs the training extra"
for package in ("torch", "onnxscript", "onnx", "einops", "safetensors"):
    pytest.importorskip(package, reason=NEEDS)
import torch

from ciir.models import cards
from ciir.models.cards import Sizes
from ciir.models.single.network import SingleImageNetwork
from ciir.training.export import external_weights, measure

with external_weights.without_torchvision():
    spandrel = pytest.importorskip("spandrel", reason=NEEDS)
from safetensors.torch import save_file
from spandrel.architectures.Compact import Compact
from spandrel.architectures.ESRGAN import ESRGAN
from spandrel.architectures.SPAN import SPAN

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning:torch")  # of tracing networks that are not ours


def saved(network, path):
    torch.save(network.state_dict(), path)
    return path


@pytest.fixture(scope="module")
def compact(tmp_path_factory):
    """SRVGGNetCompact as Real-ESRGAN has it, but small, and its card."""
    torch.manual_seed(1)
    network = Compact(num_feat=8, num_conv=1, upscale=2).eval()
    folder = tmp_path_factory.mktemp("foreign")
    file = saved(network, folder / "small-compact.pth")
    return network, file, external_weights.export_weights(file, folder / "out")


def test_the_stub_is_removed():
    assert "torchvision" not in sys.modules


def test_the_card(compact):
    network, file, path = compact
    card = cards.read_card(path)
    assert (card.name, card.scale, card.sizes) == ("small-compact", 2, Sizes())
    assert card.kind == "RealESRGAN Compact (8nf, 1nc), trained by others"
    assert card.parameters == sum(weight.numel() for weight in network.parameters())
    assert card.macs_per_output_pixel == 9 * (3 * 8 + 8 * 8 + 8 * 12) / 4
    sha256 = hashlib.sha256(file.read_bytes()).hexdigest()
    assert card.training.recipe == {"weights": "small-compact.pth", "sha256": sha256}


def test_the_file_equals_the_network(compact):
    network, _, path = compact
    images = np.random.default_rng(0).random((2, 3, 9, 30), dtype=np.float32)
    with torch.no_grad():
        want = network(torch.from_numpy(images)).clamp(0, 1).numpy()
    np.testing.assert_allclose(SingleImageNetwork(path)(images), want, atol=1e-5)


def described(network, path):
    return external_weights._load_descriptor(saved(network, path))


def test_an_esrgan_that_puts_pixels_into_channels(tmp_path):
    torch.manual_seed(2)
    esrgan = ESRGAN(in_nc=12, out_nc=3, num_filters=4, num_blocks=1, scale=4, shuffle_factor=2)
    descriptor = described(esrgan, tmp_path / "e.pth")
    network, sizes = (
        external_weights.ExternalNetwork(descriptor).eval(),
        external_weights._convert_sizes(descriptor.size_requirements),
    )
    assert (network.scale, sizes) == (2, Sizes(8, 4))
    external_weights._check_call(network, descriptor, sizes)
    assert measure.find_tile_overlap(network, 2, sizes) % 4 == 0


def test_branches_that_fold_themselves_are_folded_once(tmp_path):
    span = SPAN(num_in_ch=3, num_out_ch=3, feature_channels=8, upscale=2).eval()
    network = external_weights.ExternalNetwork(described(span, tmp_path / "s.pth")).eval()
    assert measure.count_parameters(network) < 0.4 * sum(weight.numel() for weight in span.parameters())
    image = torch.rand(1, 3, 9, 11)
    with torch.no_grad():
        torch.testing.assert_close(network(image), span(image))


def test_safetensors_and_half_precision(compact, tmp_path):
    network, _, _ = compact
    save_file({key: value.half() for key, value in network.state_dict().items()}, tmp_path / "half.safetensors")
    half = external_weights.ExternalNetwork(external_weights._load_descriptor(tmp_path / "half.safetensors")).eval()
    image = torch.rand(1, 3, 9, 11)
    with torch.no_grad():  # 11 bits a weight
        torch.testing.assert_close(half(image), network(image), atol=2e-3, rtol=0)


class Evil:
    def __reduce__(self):
        return print, ("executed",)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.onnx", {}, "not a file of weights"),
        ("a.pth", [torch.zeros(1)], "holds a list"),
        ("a.pth", {1: torch.zeros(1)}, "holds a dict, not tensors by name"),
        ("a.pth", {"x": torch.zeros(3)}, "knows no network"),
        ("a.pth", {"body.0.weight": torch.zeros(3)}, "knows no network"),
        ("a.pth", {"x": Evil()}, "without running code"),
        ("a.pth", b"not a pickle", "without running code"),
        ("a.safetensors", b"nothing", "without running code"),
        ("a.pth", Compact(num_in_ch=1, num_out_ch=1, num_feat=4, num_conv=1, upscale=2), "upscales RGB"),
        ("a.pth", Compact(num_feat=4, num_conv=1, upscale=1), "upscales RGB"),
    ],
)
def test_unusable_files(tmp_path, capfd, name, content, words):
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        torch.save(content.state_dict() if isinstance(content, torch.nn.Module) else content, path)
    with pytest.raises(ValueError, match=words) as caught:
        external_weights.export_weights(path, tmp_path / "out")
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)
    assert capfd.readouterr().out == ""


def test_a_bad_name(compact, tmp_path):
    with pytest.raises(ValueError, match=r"name: '\.\./x': give one of letters"):
        external_weights.export_weights(compact[1], tmp_path, name="../x")
