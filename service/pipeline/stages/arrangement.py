"""Which views of a light field are neighbours, even if they were given in a wrong order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ciir.models.light_field.fusion.views import list_fused_views
from ciir.models.light_field.strides import list_spaced_views

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ciir.renderer.view_order.estimate import OrderEstimate
    from ciir.renderer.views import View


@dataclass(frozen=True)
class Arrangement:
    """The places of the given views (v, u) in the right order."""

    grid: tuple[int, int]
    """Views down and across, (V, U), in the right order."""
    places: Mapping[View, View] | None = None
    """The view as given -> its place in the right order; None if they are the same."""
    stride: int = 1
    """Windows consist of every `stride`-th view."""

    def find_place(self, view: View) -> View:
        """Returns the place of the view that was given as `view`."""
        return view if self.places is None else self.places[view]

    def list_required(self, wanted: Sequence[View]) -> list[View]:
        """Lists every view, as given, in the windows around `wanted`."""
        return self.find_views(list_spaced_views([self.find_place(view) for view in wanted], self.grid, self.stride))

    def list_fused(self, wanted: Sequence[View]) -> list[View]:
        """Lists every view, as given, that may be needed if `wanted` are fused with the views around them."""
        return self.find_views(list_fused_views([self.find_place(view) for view in wanted], self.grid, self.stride))

    def find_views(self, places: Sequence[View]) -> list[View]:
        """Returns the views, as they were given, at `places`."""
        if self.places is None:
            return list(places)
        given = {place: view for view, place in self.places.items()}
        return [given[place] for place in places]


def arrange_views(grid: tuple[int, int], order: OrderEstimate | None) -> Arrangement:
    """Returns the arrangement of `grid` views that were given in `order`.

    If the order is None or not certain, it is taken to be right. If one axis is reversed, both readings of it give each
    view the same neighbours, with depth inverted, and upscaled views differ little: by up to 21 levels at edges.
    """
    if order is None or not order.is_wrong:
        return Arrangement(grid)
    given = order.put_right(np.moveaxis(np.indices(grid), 0, -1))  # (V, U, 2): the view that was given, by its place
    places = {(int(given[place][0]), int(given[place][1])): place for place in np.ndindex(given.shape[:2])}
    return Arrangement((given.shape[0], given.shape[1]), places)
