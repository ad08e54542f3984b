"""Perceptual terms: distances between pictures that depend on structure more than on single samples.

`vgg19` needs torchvision's weight file; `discriminator` (feature matching) needs none.
"""

from __future__ import annotations

import pickle
from typing import TYPE_CHECKING, Literal

import torch
from torch import Tensor, nn

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

PERCEPTUAL = ("vgg19", "discriminator")
"""The names that a recipe's `perceptual` may have."""

Layout = tuple[int | Literal["pool"], ...]
"""The output channels of each 3x3 convolution, and `pool` where the picture is halved."""
VGG19: Layout = (
    *(64, 64, "pool"),
    *(128, 128, "pool"),
    *(256, 256, 256, 256, "pool"),
    *(512, 512, 512, 512, "pool"),
    *(512, 512, 512, 512),
)
"""VGG-19 up to conv5_4 (Simonyan and Zisserman, ICLR 2015, table 1, column E)."""
MEAN, DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""ImageNet's values for R, G, B in [0, 1], which torchvision's weights were trained with."""
REMEDY = "give torchvision's vgg19-dcbb9e9d.pth, which torchvision.models.vgg19(weights='IMAGENET1K_V1') downloads"


class Vgg(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> the features of conv5_4 before its activation, `(N, 512, H // 16, W // 16)`.

    This is the VGG54 content of SRGAN (Ledig et al., CVPR 2017, equation 5), before the activation as in ESRGAN (Wang
    et al., ECCVW 2018, section 3.3). The weights are frozen. The sides must be at least 16 pixels.
    """

    def __init__(self, weights: Path, *, layout: Layout = VGG19) -> None:
        """`weights`: a state dict whose convolutions are `features.N.weight` and `features.N.bias`; keys of other
        layers are ignored. `layout`: VGG-19's, except in tests.

        Raises `ValueError` if the file is missing, is not a state dict, or belongs to another network.
        """
        super().__init__()
        self.features = _make_layers(layout)
        state = _read_weights(weights)
        for name, own in self.state_dict().items():
            given = state.get(name)
            if not isinstance(given, Tensor) or given.shape != own.shape:
                found = tuple(given.shape) if isinstance(given, Tensor) else "missing"
                raise ValueError(f"{weights}: not VGG-19: {name} is {found}, not {tuple(own.shape)}; {REMEDY}")
        self.load_state_dict({name: state[name] for name in self.state_dict()})
        self.register_buffer("mean", torch.tensor(MEAN)[:, None, None], persistent=False)
        self.register_buffer("deviation", torch.tensor(DEVIATION)[:, None, None], persistent=False)
        self.requires_grad_(False).eval()

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        features: Tensor = self.features((image - self.mean) / self.deviation)  # type: ignore[operator]
        return features


def _make_layers(layout: Layout) -> nn.Sequential:
    """Makes layers numbered like torchvision's `features`, without the last convolution's activation."""
    layers: list[nn.Module] = []
    inputs = 3
    for item in layout:
        if item == "pool":
            layers.append(nn.MaxPool2d(2))
        else:
            layers += [nn.Conv2d(inputs, item, kernel_size=3, padding=1), nn.ReLU()]
            inputs = item
    return nn.Sequential(*layers[:-1])


def _read_weights(path: Path) -> dict[str, object]:
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError as error:
        raise ValueError(f"{path}: no such file; {REMEDY}") from error
    except (OSError, RuntimeError, pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError) as error:
        raise ValueError(f"{path}: not a file of weights; {REMEDY}") from error
    return state if isinstance(state, dict) else {}


class VggContent:
    """The mean squared difference of two pictures' `Vgg` features, a float32 scalar (SRGAN, equation 5)."""

    def __init__(self, weights: Path, device: torch.device, *, bfloat16: bool = False, layout: Layout = VGG19) -> None:
        """Arguments and errors are those of `Vgg`. `bfloat16`: whether the network, not the difference, is computed in
        bfloat16.
        """
        self.network = Vgg(weights, layout=layout)
        self.network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.bfloat16 = bfloat16

    def __call__(self, output: Tensor, high: Tensor) -> Tensor:
        """Computes the loss of two pictures `(N, 3, H, W)` in [0, 1]. Gradients flow to `output` only."""
        with torch.autocast(output.device.type, torch.bfloat16, enabled=self.bfloat16):
            made = self.network(output)
            with torch.no_grad():
                real = self.network(high)
        loss: Tensor = (made.float() - real.float()).square().mean()
        return loss


def feature_matching(output: Sequence[Tensor], high: Sequence[Tensor]) -> Tensor:
    """Computes the mean absolute difference of a discriminator's feature maps, averaged over its layers; a float32
    scalar.

    Pix2PixHD (Wang et al., CVPR 2018, equation 4), with the mean over the layers instead of the sum.
    """
    layers = [(made.float() - real.float()).abs().mean() for made, real in zip(output, high, strict=True)]
    return torch.stack(layers).mean()
