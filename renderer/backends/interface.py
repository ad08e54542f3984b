"""The interface that every rendering backend has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from ciir.renderer.lens_array import LensArray
    from ciir.renderer.scene import Scene
    from ciir.renderer.views import View


class Backend(Protocol):
    """Renders a scene that already stands in front of the lens array. May be called from several threads at once."""

    name: str

    def render_views(
        self,
        scene: Scene,
        array: LensArray,
        views: Sequence[View],
        *,
        samples: int = 1,
        background: tuple[int, int, int] = (0, 0, 0),
    ) -> Iterator[NDArray[np.uint8]]:
        """Each of `views` in turn, `(rows, cols, 4)` RGBA; alpha is the share of the lens that the scene covers.

        `samples`: point samples along each side of a lens cell, 1 to 16 (see `renderer.sampling`). `background`: RGB,
        0 to 255. Raises `InvalidOption` where `samples` or the picture is out of range.
        """
        ...

    def render_depth(self, scene: Scene, array: LensArray, views: Sequence[View]) -> Iterator[NDArray[np.float32]]:
        """The depth of each of `views`, `(rows, cols)`: the distance from the array's plane along -z, in scene units.

        Of the point that the ray through each lens's centre meets; +inf where it meets nothing. There is one ray for
        each lens: a mean over several depths would lie on no surface. For more of them refine the array.
        """
        ...

    def render_eia(
        self,
        scene: Scene,
        array: LensArray,
        *,
        samples: int = 1,
        background: tuple[int, int, int] = (0, 0, 0),
    ) -> NDArray[np.uint8]:
        """The elemental image array, `(rows*pixels_v, cols*pixels_u, 4)` RGBA, with the same samples as `views`."""
        ...
