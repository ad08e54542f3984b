"""Differences between captured views of one scene: brightness, blur, noise, and JPEG of views or of whole EIAs."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ciir.models.light_field.network import LUMA
from ciir.models.light_field.windows import WINDOW_SIDE
from ciir.training.data.light_field import grey_jpeg

MISMATCHED = 0.04
"""Share of crops whose other views show another scene."""
NOISE = (0.01, 0.1)
"""Share of crops with heavy noise, different in each view, and its standard deviation."""
GRAIN = (0.14, 6 / 255)
"""Share of crops with camera grain in the LR views, and its largest standard deviation."""
BRIGHTNESS = (0.35, 0.015, 0.004)
"""Share of crops whose views differ in brightness; the largest relative change from one view to the next; and the
standard deviation of the factors around it."""
BLUR = (0.25, 0.12)
"""Share of crops whose views differ in blur, and the largest weight of a pixel's neighbour along each axis."""
JPEG = (0.07, 0.05, 55)
"""Share of crops whose elemental image array went through JPEG, share of crops whose views did, and lowest quality."""


def differ(
    random: np.random.Generator, image: Tensor, around: Tensor, own: tuple[int, int], ease: float = 1.0
) -> tuple[Tensor, Tensor]:
    """Changes some of the crops: `image` `(N, 3, H, W)`, and `around`, the luma of its window `(N, 25, H, W)`, in which
    it has the row and column `own`. `ease`: factor on the shares, up to 1.
    """
    number, device = own[0] * WINDOW_SIDE + own[1], image.device
    noise = torch.Generator(device).manual_seed(int(random.integers(2**62)))

    def share(of: float) -> Tensor:
        return torch.from_numpy(random.random(len(image)) < of * ease)[:, None, None, None].to(device)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return torch.from_numpy(random.uniform(low, high, shape).astype(np.float32)).to(device)

    def normal(like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=noise, device=device)

    around = torch.where(share(MISMATCHED), around.roll(1, 0), around)
    offsets = torch.cartesian_prod(*(torch.arange(WINDOW_SIDE) - at for at in own)).float().to(device)  # (25, 2)
    often, step, apart = BRIGHTNESS
    slopes = uniform(-step, step, len(image), 2)
    factors = 1 + slopes @ offsets.T + apart * normal(around[:, :, 0, 0])
    around = torch.where(share(often), (around * factors[..., None, None]).clamp(0, 1), around)
    often, most = BLUR
    around = torch.where(share(often), _blur(around, uniform(0, most, *around.shape[:2], 1, 1)), around)
    seldom, strong = NOISE
    often, most = GRAIN
    deviation = share(seldom) * strong + share(often) * uniform(0, most, len(image), 1, 1, 1)
    image = (image + deviation * normal(image)).clamp(0, 1)
    around = (around + deviation * sum(weight**2 for weight in LUMA) ** 0.5 * normal(around)).clamp(0, 1)
    before = compute_luma(image)
    around = around.clone()
    around[:, number] = before[:, 0]
    of_arrays, of_views, lowest = JPEG
    kinds = random.random(len(image))
    for is_array, chosen in (
        (True, np.flatnonzero(kinds < of_arrays * ease)),
        (False, np.flatnonzero((kinds >= of_arrays * ease) & (kinds < (of_arrays + of_views) * ease))),
    ):
        if len(chosen):
            crops = torch.from_numpy(chosen).to(device)
            qualities = torch.from_numpy(random.integers(lowest, 96, len(chosen))).to(device)
            around[crops] = _compress(around[crops], qualities, is_array=is_array)
    image = (image + around[:, number : number + 1] - before).clamp(0, 1)
    around[:, number] = compute_luma(image)[:, 0]
    return image, around


def compute_luma(image: Tensor) -> Tensor:
    """Computes the luma of `(N, 3, H, W)`: `(N, 1, H, W)`."""
    return torch.einsum("nchw,c->nhw", image, image.new_tensor(LUMA))[:, None]


def _blur(around: Tensor, weight: Tensor) -> Tensor:
    """Blurs each picture `(N, V, H, W)` with `weight` `(N, V, 1, 1)` for each neighbour, one axis after the other."""
    padded = functional.pad(around, (1, 1, 1, 1), mode="replicate")
    across = (1 - 2 * weight) * padded[..., 1:-1] + weight * (padded[..., :-2] + padded[..., 2:])
    return (1 - 2 * weight) * across[..., 1:-1, :] + weight * (across[..., :-2, :] + across[..., 2:, :])


def _compress(views: Tensor, qualities: Tensor, *, is_array: bool) -> Tensor:
    """Compresses views `(N, 25, H, W)` as a JPEG of their elemental image array, or of the views side by side. Each
    window has its own quality.
    """
    grid = views.reshape(-1, WINDOW_SIDE, WINDOW_SIDE, *views.shape[2:])
    order = (0, 3, 1, 4, 2) if is_array else (0, 1, 3, 2, 4)
    joined = grid.permute(order)
    levels = joined.flatten(3, 4).flatten(1, 2).mul(255).round()
    back = grey_jpeg.compress(levels, qualities).div(255).reshape(joined.shape)
    return back.permute(*np.argsort(order).tolist()).flatten(1, 2)
