"""Light fields of random layered scenes: textured layers at different distances, cut out, slanted and folded.

Each view is sampled where its own rays meet the layers, twice as finely as the truth along each side, and downscaled
afterwards. Folds (`training.data.light_field.planes`) cover everything behind their layer.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ciir.training.data.light_field import planes
from ciir.training.data.solids import draw_background

if TYPE_CHECKING:
    from collections.abc import Callable

    from _typeshed import SupportsLenAndGetItem

    from ciir.training.data.pictures import Picture

FINE = 4
"""Samples along each side of an LR pixel; the truth has half as many pixels as these."""
LAYERS = (2, 5)
MOST = 2.0
"""Largest disparity, LR pixels from one view to the next: 4 of the truth's pixels."""
SMALLEST = 0.03
"""By how much a scene's disparities may be smaller than that: captured views are often close together."""
SMALL = 0.6
"""Share of scenes whose disparities are made smaller, evenly in the logarithm."""
BEYOND = 0.05
"""Share of scenes whose disparities are up to 4 times as large: no plane matches these."""
TEXTURE = 160
"""Texels along each side of a layer's texture, which is mirrored at its edge."""
TEXELS = (0.45, 1.6)
"""Texels for each fine sample."""
FLAT = 0.12
"""Share of layers of one colour."""
PLAIN = 0.3
"""Share of scenes before a plain background, as rendered objects stand."""
MASK = 24
MASK_REACH = 0.75
"""How far a mask reaches to each side of the middle, in sides of a picture."""
STRAIGHT = 0.35
"""Share of masks that are a straight edge."""
STRIPED = 0.12
"""Share of masks that are thin bars."""
HALF_BAR = (0.05, 0.2)
"""Half the width of a bar, over half the width of a mask."""
STEEPNESS = (4.0, 200.0)
"""How sharp a layer's edge is: over `MASK_REACH` sides of the picture divided by this."""
FOLDED = 0.6
"""Share of layers with a straight edge that are folded there, as a roof at a wall: only some views see the fold."""
LUMA = (0.299, 0.587, 0.114)


def make_scenes(
    random: np.random.Generator,
    pictures: SupportsLenAndGetItem[Picture],
    count: int,
    *,
    side: int,
    window: int,
    own: tuple[int, int],
) -> tuple[Tensor, Tensor]:
    """Renders the views of a window of `count` scenes.

    `pictures`: 8-bit RGB, at least `TEXTURE` pixels a side. `side`: LR pixels along a view. `window`: views along a
    side. `own`: row and column in the window of the view that is to be upscaled.

    Returns luma of all views, row by row, `(count, window*window, FINE*side, FINE*side)`, and the own one in colour,
    `(count, 3, FINE*side, FINE*side)`, in [0, 1]. Content moves by `disparity * offset` from the own one to a view.
    """

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return torch.from_numpy(random.uniform(low, high, shape).astype(np.float32))

    most = LAYERS[1]
    disparity, slope = _draw_disparities(uniform, count, side)
    angle, size = (
        uniform(0, 2 * math.pi, count, most),
        torch.exp(uniform(math.log(TEXELS[0]), math.log(TEXELS[1]), count, most)),
    )
    turn = torch.stack([torch.stack([angle.cos(), -angle.sin()], -1), torch.stack([angle.sin(), angle.cos()], -1)], -2)
    turn = (turn * size[..., None, None] * (2 * FINE / TEXTURE)).flip(2)  # LR pixels -> [-1, 1] of the texture, x first
    begin = uniform(-0.2, 0.2, count, most, 2)
    to_mask = torch.eye(2).flip(0) / (MASK_REACH * side)
    threshold = uniform(-0.3, 0.6, count, most)
    steepness = torch.exp(uniform(math.log(STEEPNESS[0]), math.log(STEEPNESS[1]), count, most))
    numbers = random.integers(LAYERS[0], most + 1, count)
    steps = torch.arange(window)
    offsets = torch.cartesian_prod(steps - own[0], steps - own[1]).float()  # (V, 2): down, right
    middle = own[0] * window + own[1]
    along = (torch.arange(side * FINE) + 0.5) / FINE - side / 2
    weights = torch.tensor(LUMA)[:, None, None]

    views: list[Tensor] = []
    colours: list[Tensor] = []
    for scene in range(count):
        seen, colour = torch.zeros(()), torch.zeros(())
        for layer in range(int(numbers[scene])):
            place_of_layer = disparity[scene, layer], slope[scene, layer]
            at = planes.intersect_layer(offsets, *place_of_layer)
            texture = _draw_texture(random, pictures)
            if layer == 0 and random.random() < PLAIN:
                shade = torch.tensor(draw_background(random)).float().div(255)
                texture = shade[:, None, None].expand_as(texture)
            place = at.compose(turn[scene, layer], begin[scene, layer]).apply(along)
            new = _sample_picture((texture * weights).sum(0, keepdim=True), place, "reflection")[:, 0]
            new_colour = _sample_picture(texture, place[middle : middle + 1], "reflection")[0]
            if layer == 0:
                seen, colour = new, new_colour
                continue
            mask, normal = _draw_mask(random)
            if normal is not None and random.random() < FOLDED:
                edge = float(threshold[scene, layer]) * MASK_REACH * side * (MASK - 1) / MASK
                shade = _draw_texture(random, pictures).mean((1, 2))[:, None, None]
                there = planes.make_fold(random, normal, edge).coverage(along, offsets, *place_of_layer)
                seen = seen + there * ((shade * weights).sum() - seen)
                colour = colour + there[middle] * (shade - colour)
                steepness[scene, layer] = STEEPNESS[1]
            alpha = _sample_picture(mask, at.compose(to_mask, to_mask.new_zeros(2)).apply(along), "border")[:, 0]
            alpha = ((alpha - threshold[scene, layer]) * steepness[scene, layer] + 0.5).clamp(0, 1)
            seen, colour = seen + alpha * (new - seen), colour + alpha[middle] * (new_colour - colour)
        views.append(seen)
        colours.append(colour)
    return torch.stack(views), torch.stack(colours)


def _draw_disparities(uniform: Callable[..., Tensor], count: int, side: int) -> tuple[Tensor, Tensor]:
    """Draws the disparity of each layer in the middle of the picture `(count, layers)`, and its slope
    `(count, layers, 2)` in LR pixels of disparity for each LR pixel. Layers are sorted from back to front; near may be
    either sign.
    """
    most = LAYERS[1]
    disparity = uniform(-0.8, 0.8, count, 1) + uniform(0, 0.8, count, 1) * uniform(-1, 1, count, most)
    disparity = (MOST * disparity).clamp(-MOST, MOST).sort(1)[0]
    turned = uniform(0, 1, count) < 0.5
    disparity[turned] = disparity[turned].flip(1)
    slope = uniform(-0.6, 0.6, count, most, 2) * (uniform(0, 1, count, most, 1) < 0.5) * (MOST / side)
    limit = ((MOST - disparity.abs()) / (side / 2) * 0.7)[..., None]
    slope = torch.maximum(torch.minimum(slope, limit), -limit)
    kind, small = uniform(0, 1, count), torch.exp(uniform(math.log(SMALLEST), 0.0, count))
    factor = torch.where(kind < SMALL, small, torch.where(kind > 1 - BEYOND, 1 + 3 * uniform(0, 1, count), 1.0))
    return disparity * factor[:, None], slope * factor[:, None, None].clamp(max=1)


def _sample_picture(picture: Tensor, place: Tensor, beyond: str) -> Tensor:
    """Samples `(C, h, w)` at `(V, H, W, 2)`, x and y in [-1, 1], bilinearly -> `(V, C, H, W)`."""
    every = picture[None].expand(len(place), -1, -1, -1)
    return functional.grid_sample(every, place, padding_mode=beyond, align_corners=False)


def _draw_texture(random: np.random.Generator, pictures: SupportsLenAndGetItem[Picture]) -> Tensor:
    """Cuts a part of a random picture, `(3, TEXTURE, TEXTURE)` in [0, 1], or takes its mean colour."""
    picture = pictures[int(random.integers(len(pictures)))]
    y, x = (int(random.integers(length - TEXTURE + 1)) for length in picture.shape[:2])
    part = torch.from_numpy(picture[y : y + TEXTURE, x : x + TEXTURE].copy()).permute(2, 0, 1).float().div(255)
    return part.mean((1, 2), keepdim=True).expand_as(part) if random.random() < FLAT else part


def _draw_mask(random: np.random.Generator) -> tuple[Tensor, Tensor | None]:
    """Draws smooth random values `(1, MASK, MASK)`: the layer is where they exceed a threshold. Some have a straight
    edge and are returned with its normal `(2,)`.
    """
    kind = random.random()
    if kind < STRIPED:
        return _draw_stripes(random), None
    if kind < STRIPED + STRAIGHT:
        angle, along = random.uniform(0, 2 * math.pi), torch.linspace(-1, 1, MASK)
        normal = torch.tensor([math.cos(angle), math.sin(angle)])
        return (normal[0] * along[:, None] + normal[1] * along[None])[None], normal
    knots = int(random.integers(3, 13))
    rough = torch.from_numpy(random.uniform(-1, 1, (1, 1, knots, knots)).astype(np.float32))
    return functional.interpolate(rough, size=MASK, mode="bicubic", align_corners=True)[0], None


def _draw_stripes(random: np.random.Generator) -> Tensor:
    """Draws smooth values `(1, MASK, MASK)` whose highest are one or a few thin parallel bars, as legs and branches."""
    angle, along = random.uniform(0, math.pi), torch.linspace(-1, 1, MASK)
    across = math.cos(angle) * along[:, None] + math.sin(angle) * along[None]
    half = float(np.exp(random.uniform(*np.log(HALF_BAR))))
    apart = random.uniform(6 * half, 1.5)
    distance = ((across - random.uniform(-0.5, 0.5) + apart / 2) % apart - apart / 2).abs()
    return (1 - distance / half)[None]
