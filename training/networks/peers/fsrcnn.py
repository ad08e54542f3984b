"""FSRCNN, d = 56, s = 12, m = 4, with a 9x9 deconvolution at the end (Dong et al., ECCV 2016)."""

from __future__ import annotations

from torch import Tensor, nn

KERNEL = 9
"""Side of the deconvolution's kernel."""


def make_deconvolution(inputs: int, outputs: int, scale: int) -> nn.ConvTranspose2d:
    """Makes a layer `(N, inputs, H, W)` -> `(N, outputs, scale*H, scale*W)`, which is exact for every size.

    An odd kernel can't be centred on an even number of samples, so its support is half a sample to the upper left.
    """
    extra = (KERNEL - scale) % 2
    padding = (KERNEL - scale + extra) // 2
    return nn.ConvTranspose2d(inputs, outputs, KERNEL, stride=scale, padding=padding, output_padding=extra)


class FSRCNN(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`.

    ::

        x     = PReLU(conv5x5(image))                    colours -> d
        x     = PReLU(conv1x1(x))                        d -> s, shrinking
        x     = PReLU(conv3x3(x))                        s -> s, m times
        x     = PReLU(conv1x1(x))                        s -> d, expanding
        image = deconvolution9x9(x)                      d -> colours

    The original works on Y (`colours = 1`: 12,464 weights). The deconvolution starts from a Gaussian of deviation
    0.001.
    """

    def __init__(self, d: int = 56, s: int = 12, m: int = 4, scale: int = 2, colours: int = 3) -> None:
        super().__init__()
        self.scale = scale
        self.body = nn.Sequential()
        layers = [(colours, d, 5), (d, s, 1), *[(s, s, 3)] * m, (s, d, 1)]
        for inputs, outputs, side in layers:
            convolution = nn.Conv2d(inputs, outputs, side, padding=side // 2)
            activation = nn.PReLU(outputs)
            nn.init.kaiming_normal_(convolution.weight, a=activation.init)
            nn.init.zeros_(convolution.bias)  # type: ignore[arg-type]
            self.body.extend([convolution, activation])
        self.tail = make_deconvolution(d, colours, scale)
        nn.init.normal_(self.tail.weight, std=0.001)
        nn.init.zeros_(self.tail.bias)  # type: ignore[arg-type]

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        output: Tensor = self.tail(self.body(image))
        return output
