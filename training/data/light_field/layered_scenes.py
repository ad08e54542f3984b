"""Light fields of random layered scenes: textured layers at different distances, cut out, slanted and folded.

Each view is sampled where its own rays meet the layers, twice as finely as the truth along each side, and downscaled
afterwards. Folds (`training.data.light_field.planes`) cover everything behind their layer. All scenes of a call are
made at once on the device of their textures.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ciir.models.light_field.network import LUMA
from ciir.training.data.light_field import planes
from ciir.training.data.light_field.textures import TEXTURE, Textures
from ciir.training.data.solids import draw_background

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.models.light_field.planes import Range

    Array = NDArray[np.float32]

FINE = 4
"""Number of samples along each side of an LR pixel. The truth has half as many pixels."""
LAYERS = (2, 5)
NARROW = 0.3
"""Share of scenes whose layers are closer together than the range of disparities."""
NARROWEST = 0.03
"""Smallest share of the range that these use, uniform in the logarithm."""
BEYOND = 0.05
"""Share of scenes that reach up to 4 times as far as the range. No plane matches them."""
TEXELS = (0.45, 1.6)
"""Range of texels for each fine sample. A layer's texture is mirrored at its edge."""
FLAT = 0.12
"""Share of layers of one colour."""
BRIGHT = (0.12, 2.5)
"""Share of layers that are overexposed, and the largest factor."""
PLAIN = 0.3
"""Share of scenes in front of a plain background, like rendered objects."""
MASK = 24
MASK_REACH = 0.75
"""How far a mask reaches on each side of the middle, in sides of a picture."""
STRAIGHT = 0.35
"""Share of masks that are a straight edge."""
STRIPED = 0.12
"""Share of masks that are thin bars."""
HALF_BAR = (0.05, 0.2)
"""Range of half the width of a bar, divided by half the width of a mask."""
KNOTS = (3, 12)
"""Range of the number of random values along each side that other masks are interpolated from."""
STEEPNESS = (4.0, 200.0)
"""Range of the sharpness of a layer's edge, which extends over `MASK_REACH` sides of the picture divided by this."""
FOLDED = 0.6
"""Share of layers with a straight edge that are folded there, like a roof at a wall. Only some views see the fold."""


class _Layers(NamedTuple):
    """The random values of the layers of all scenes: `n` scenes of `m` layers, from back to front."""

    disparity: Tensor
    """Disparity in the middle of the picture, LR pixels, `(n, m)`."""
    slope: Tensor
    """LR pixels of disparity for each LR pixel, `(n, m, 2)`."""
    there: Tensor
    """1 where a scene has the layer, `(n, m)`."""
    turn: Tensor
    """Matrix from LR pixels to [-1, 1] of the texture, x first, `(n, m, 2, 2)`."""
    begin: Tensor
    """`(n, m, 2)`."""
    textures: Tensor
    """`(n, m, 3, TEXTURE, TEXTURE)`."""
    masks: Tensor
    """A layer is present where its mask exceeds the threshold, `(n, m, 1, MASK, MASK)`."""
    threshold: Tensor
    steepness: Tensor
    normal: Tensor
    """Normal of a straight edge, `(n, m, 2)`."""
    folded: NDArray[np.bool_]
    """Whether the layer is folded, `(n, m)`, on the CPU."""
    change: Tensor
    width: Tensor
    """`change` and `width` are those of folds."""


def make_scenes(
    random: np.random.Generator,
    textures: Textures,
    count: int,
    *,
    side: int,
    window: int,
    own: tuple[int, int],
    disparities: Range,
) -> tuple[Tensor, Tensor]:
    """Renders the views of a window of `count` scenes.

    `side`: LR pixels along each side of a view. `window`: views along each side. `own`: row and column, in the window,
    of the view to be upscaled. `disparities`: the range of most scenes, LR pixels from one view to the next.

    Returns luma of all views, row by row, `(count, window*window, FINE*side, FINE*side)`, and the view at `own` in
    colour, `(count, 3, FINE*side, FINE*side)`, in [0, 1]. Content moves by `disparity * offset` from that view to
    another.
    """
    layers = _draw_layers(random, textures, count, side, disparities)
    device = layers.disparity.device
    steps = torch.arange(window, device=device)
    offsets = torch.cartesian_prod(steps - own[0], steps - own[1]).float()  # (V, 2): down, right
    middle = own[0] * window + own[1]
    along = (torch.arange(side * FINE, device=device) + 0.5) / FINE - side / 2
    weights = torch.tensor(LUMA, device=device)[:, None, None]
    to_mask = (torch.eye(2, device=device).flip(0) / (MASK_REACH * side)).expand(count, 2, 2)
    no_shift = torch.zeros(count, 2, device=device)
    seen, colour = torch.zeros((), device=device), torch.zeros((), device=device)
    for layer in range(layers.disparity.shape[1]):
        place_of_layer = layers.disparity[:, layer], layers.slope[:, layer]
        at = planes.intersect_layer(offsets, *place_of_layer)
        texture = layers.textures[:, layer]
        to_texture = layers.turn[:, layer], layers.begin[:, layer]
        new = _sample((texture * weights).sum(1, keepdim=True), at.compose(*to_texture), along, "reflection")[:, 0]
        new_colour = _sample(texture, at.select(middle).compose(*to_texture), along, "reflection")[:, :, 0]
        if layer == 0:
            seen, colour = new, new_colour
            continue
        folded = layers.folded[:, layer].nonzero()[0]
        if len(folded):
            chosen = torch.from_numpy(folded).to(device)
            shade = layers.textures[(chosen + 1) % count, layer].mean((2, 3))[:, :, None, None]
            edge = layers.threshold[chosen, layer] * MASK_REACH * side * (MASK - 1) / MASK
            drawn = (of[chosen, layer] for of in (layers.change, layers.width))
            fold = planes.Fold(layers.normal[chosen, layer], edge, *drawn)
            covered = fold.coverage(along, offsets, *(of[chosen] for of in place_of_layer))
            covered = covered * layers.there[chosen, layer][:, None, None, None]
            seen[chosen] += covered * ((shade * weights).sum(1, keepdim=True) - seen[chosen])
            colour[chosen] += covered[:, middle, None] * (shade - colour[chosen])
        mask = _sample(layers.masks[:, layer], at.compose(to_mask, no_shift), along, "border")[:, 0]
        threshold, steepness, there = (
            of[:, layer, None, None, None] for of in (layers.threshold, layers.steepness, layers.there)
        )
        alpha = ((mask - threshold) * steepness + 0.5).clamp(0, 1) * there
        seen = seen + alpha * (new - seen)
        colour = colour + alpha[:, middle, None] * (new_colour - colour)
    return seen, colour


def _draw_layers(random: np.random.Generator, textures: Textures, count: int, side: int, disparities: Range) -> _Layers:
    most = LAYERS[1]
    disparity, slope = _draw_disparities(random, count, side, disparities)
    angle = random.uniform(0, 2 * math.pi, (count, most))
    size = planes.draw_log_uniform(random, TEXELS, (count, most)) * (2 * FINE / TEXTURE)
    turn = np.stack([np.stack([np.sin(angle), np.cos(angle)], -1), np.stack([np.cos(angle), -np.sin(angle)], -1)], -2)
    there = np.arange(most) < random.integers(LAYERS[0], most + 1, count)[:, None]
    cut = textures.cut(random, count * most).reshape(count, most, 3, TEXTURE, TEXTURE)
    flat = torch.from_numpy(random.random((count, most)) < FLAT)
    plain = np.flatnonzero(random.random(count) < PLAIN)
    shades = torch.tensor([draw_background(random) for _ in plain]).float().div(255)
    device = cut.device
    gain = np.where(random.random((count, most)) < BRIGHT[0], random.uniform(1, BRIGHT[1], (count, most)), 1.0)
    cut = (cut * torch.from_numpy(gain.astype(np.float32)).to(device)[..., None, None, None]).clamp(max=1)
    cut = torch.where(flat.to(device)[..., None, None, None], cut.mean((3, 4), keepdim=True), cut)
    if len(plain):
        cut[torch.from_numpy(plain).to(device), 0] = shades.to(device)[:, :, None, None]
    masks, normal, straight = _draw_masks(random, count * most)
    folded = straight.reshape(count, most) & (random.random((count, most)) < FOLDED)
    steepness = planes.draw_log_uniform(random, STEEPNESS, (count, most))
    change, width = (of.reshape(count, most) for of in planes.draw_folds(random, count * most))

    def place(values: NDArray[np.generic]) -> Tensor:
        return torch.from_numpy(values.astype(np.float32)).to(device)

    return _Layers(
        place(disparity),
        place(slope),
        place(there),
        place(turn * size[..., None, None]),
        place(random.uniform(-0.2, 0.2, (count, most, 2))),
        cut,
        masks.reshape(count, most, 1, MASK, MASK).to(device),
        place(random.uniform(-0.3, 0.6, (count, most))),
        place(np.where(folded, STEEPNESS[1], steepness)),
        place(normal.reshape(count, most, 2)),
        folded,
        place(change),
        place(width),
    )


def _draw_disparities(
    random: np.random.Generator, count: int, side: int, disparities: Range
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Draws the disparity of each layer in the middle of the picture `(count, layers)`, and its slope
    `(count, layers, 2)` in LR pixels of disparity for each LR pixel. Layers are sorted from back to front. Near layers
    may have disparities of either sign.
    """
    most = LAYERS[1]
    middle, half = sum(disparities) / 2, (disparities.highest - disparities.lowest) / 2
    place = random.uniform(-0.8, 0.8, (count, 1)) + random.uniform(0, 0.8, (count, 1)) * random.uniform(
        -1, 1, (count, most)
    )
    place = np.sort(place.clip(-1, 1), axis=1)
    turned = random.random(count) < 0.5
    place[turned] = place[turned, ::-1]
    slope = random.uniform(-0.6, 0.6, (count, most, 2)) * (random.random((count, most, 1)) < 0.5) / side
    limit = (1 - np.abs(place))[..., None] / (side / 2) * 0.7
    slope = slope.clip(-limit, limit)
    kind = random.random(count)
    narrow = np.exp(random.uniform(math.log(NARROWEST), 0, count))
    factor = np.where(kind < NARROW, narrow, np.where(kind > 1 - BEYOND, 1 + 3 * random.random(count), 1.0))
    start = np.where(kind < NARROW, random.uniform(-1, 1, count) * (1 - narrow), 0.0)
    disparity = middle + half * (start[:, None] + place * factor[:, None])
    return disparity, half * slope * np.minimum(factor, 1)[:, None, None]


def _sample(pictures: Tensor, at: planes.AffineMap, along: Tensor, beyond: str) -> Tensor:
    """Samples pictures `(N, C, h, w)`, x and y in [-1, 1], bilinearly at pixels `along` of all views:
    `(N, C, V, side, side)`.
    """
    place = at.apply(along)
    made = functional.grid_sample(pictures, place.flatten(1, 2), padding_mode=beyond, align_corners=False)
    return made.reshape(*made.shape[:2], *place.shape[1:4])


def _draw_masks(random: np.random.Generator, count: int) -> tuple[Tensor, NDArray[np.float64], NDArray[np.bool_]]:
    """Draws masks of smooth random values `(count, 1, MASK, MASK)`. A layer is present where they exceed a threshold.

    Also returns the normal of a straight edge, `(count, 2)`, and which masks have one. In some masks the highest values
    form one or a few thin parallel bars, like legs and branches.
    """
    kind, line = random.random(count), np.linspace(-1, 1, MASK)
    angle = random.uniform(0, 2 * math.pi, count)
    normal = np.stack([np.cos(angle), np.sin(angle)], -1)
    across = normal[:, 0, None, None] * line[:, None] + normal[:, 1, None, None] * line
    half = planes.draw_log_uniform(random, HALF_BAR, (count, 1, 1))
    apart = 6 * half + random.random((count, 1, 1)) * (1.5 - 6 * half)
    distance = (across - random.uniform(-0.5, 0.5, (count, 1, 1)) + apart / 2) % apart - apart / 2
    is_striped, straight = kind < STRIPED, (kind >= STRIPED) & (kind < STRIPED + STRAIGHT)
    shaped = np.where(is_striped[:, None, None], 1 - np.abs(distance) / half, across)
    masks = torch.from_numpy(shaped.astype(np.float32))[:, None]
    smooth = np.flatnonzero(kind >= STRIPED + STRAIGHT)
    knots = random.integers(KNOTS[0], KNOTS[1] + 1, len(smooth))
    for number in range(KNOTS[0], KNOTS[1] + 1):
        some = torch.from_numpy(smooth[knots == number])
        rough = torch.from_numpy(random.uniform(-1, 1, (len(some), 1, number, number)).astype(np.float32))
        if len(some):
            masks[some] = functional.interpolate(rough, size=MASK, mode="bicubic", align_corners=True)
    return masks, normal, straight
