"""Two convolutions and a deconvolution, for sparse camera arrays (reference 44 of Wu et al., Applied Sciences 2024).

Wu et al. (section 1) describe it only as "two convolutions, an activation function, and a deconvolution"; the reference
itself was not available. The kernels of 5x5 and 3x3 with 64 and 32 channels follow FSRCNN's and SRCNN's first layers.
The deconvolution's kernel is twice the scale and centred on its pixel.
"""

from __future__ import annotations

from torch import Tensor, nn


class SparseCameraGenerator(nn.Module):
    """RGB in [0, 1], `(N, 3, H, W)` -> RGB, nominally in [0, 1], `(N, 3, scale*H, scale*W)`; `scale` is even.

    ::

        image = deconvolution(conv3x3(ReLU(conv5x5(image))))         3 -> 64 -> 32 -> 3

    Raises `ValueError` for an odd scale.
    """

    def __init__(self, scale: int = 2) -> None:
        super().__init__()
        if scale % 2:
            raise ValueError(f"scale: the deconvolution can't keep the phase at {scale}; give an even one")
        self.scale = scale
        self.first = nn.Conv2d(3, 64, kernel_size=5, padding=2)
        self.activation = nn.ReLU()
        self.second = nn.Conv2d(64, 32, kernel_size=3, padding=1)
        self.tail = nn.ConvTranspose2d(32, 3, kernel_size=2 * scale, stride=scale, padding=scale // 2)

    def forward(self, image: Tensor) -> Tensor:
        """See the class."""
        output: Tensor = self.tail(self.second(self.activation(self.first(image))))
        return output
