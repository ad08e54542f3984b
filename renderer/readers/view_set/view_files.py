"""Views in files, each decoded when it is first used."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ciir.cores import count_available_cores
from ciir.errors import TooLarge, Unreadable
from ciir.renderer.light_field import LightField
from ciir.renderer.readers import pictures
from ciir.renderer.readers.names import clean_text
from ciir.renderer.readers.picture_sizes import find_size
from ciir.renderer.views import flip_axes

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from ciir.renderer.limits import Limits
    from ciir.renderer.readers.pictures import Pixels
    from ciir.renderer.views import DepthSense, Flip, View


class Decoder:
    """Decodes the pictures of a set, which must all be alike, and keeps those that have not been taken yet."""

    def __init__(self, files: Mapping[str, bytes], name: str, limits: Limits) -> None:
        self._files, self._name, self._limits = files, name, limits
        self._first: tuple[str, tuple[int, ...], np.dtype[np.uint8] | np.dtype[np.uint16]] | None = None
        self._kept: dict[str, Pixels] = {}

    def decode(self, file: str) -> Pixels:
        """Decodes the picture `(H, W, C)` in `file`.

        Raises like `pictures.decode`, and `Unreadable` if the picture differs in size, channels or depth from those
        decoded before.
        """
        pixels = pictures.decode(self._files[file], name=clean_text(file), max_pixels=self._limits.pixels)
        first, *like = self._first = self._first or (file, pixels.shape, pixels.dtype)
        if [pixels.shape, pixels.dtype] != like:
            raise Unreadable(
                f"{self._name}: {clean_text(file)} is {_describe(pixels.shape, pixels.dtype)} but {clean_text(first)} "
                f"is {_describe(*self._first[1:])}; make all views alike"
            )
        return pixels

    def describe_views(self, file: str) -> tuple[tuple[int, ...], np.dtype[np.uint8] | np.dtype[np.uint16]]:
        """Returns the shape and type of all views; decodes `file` if none was decoded before."""
        if self._first is None:
            self.keep(file)
        assert self._first is not None  # noqa: S101 - `keep` has set it
        return self._first[1:]

    def keep(self, file: str) -> Pixels:
        """Decodes like `decode`, but only once until the picture is taken. Raises `TooLarge` if more than
        `limits.set_bytes` is kept.
        """
        if file not in self._kept:
            pixels = self.decode(file)
            self.check_size(len(self._kept) + 1, pixels)
            self._kept[file] = pixels
        return self._kept[file]

    def take(self, file: str) -> Pixels:
        """Decodes like `decode` a picture that is not needed again."""
        return self._kept.pop(file) if file in self._kept else self.decode(file)

    def check_size(self, count: int, pixels: Pixels) -> None:
        """Raises `TooLarge` if `count` pictures like `pixels` are over the limit."""
        if count * pixels.nbytes > self._limits.set_bytes:
            raise TooLarge(
                f"{self._name}: {count} views of {_describe(pixels.shape, pixels.dtype)} come to "
                f"{count * pixels.nbytes:,} bytes; at most {self._limits.set_bytes:,} are read; give fewer views or "
                "smaller ones",
                "set_bytes",
            )


def check_sizes(files: Mapping[str, bytes], views: Sequence[str], name: str) -> None:
    """Raises `Unreadable` if the headers of `views` state different sizes, before any of them is decoded.

    Height and width may be exchanged, because decoding may turn a picture.
    """
    first = None
    for file in views:
        size = find_size(files, file)
        if size is None:
            continue
        first = first or (file, size)
        if sorted(size) != sorted(first[1]):
            raise Unreadable(
                f"{name}: {clean_text(file)} is {size[0]}x{size[1]} pixels but {clean_text(first[0])} is "
                f"{first[1][0]}x{first[1][1]} pixels; make all views alike"
            )


@dataclass(frozen=True, eq=False)
class ViewFiles:
    """A light field `L[v, u, y, x, c]` whose views are files, each decoded when it is first used."""

    decoder: Decoder
    files: NDArray[np.object_]
    """The name of each view's file, `(V, U)`."""
    some: str
    """The file that is decoded to find the size of the views."""
    notes: tuple[str, ...] = ()
    is_ordered: bool = False
    depth_sense: DepthSense = field(default="cameras", kw_only=True)

    @property
    def shape(self) -> tuple[int, int, int, int, int]:
        """The shape `(V, U, H, W, C)`."""
        return (*self.files.shape, *self.decoder.describe_views(self.some)[0])

    @property
    def dtype(self) -> np.dtype[np.uint8] | np.dtype[np.uint16]:
        """The type of the pixels."""
        return self.decoder.describe_views(self.some)[1]

    def flip(self, axes: Flip) -> ViewFiles:
        """Flips the views like `LightField.flip`."""
        files, depth_sense = flip_axes(self.files, axes, self.depth_sense)
        return replace(
            self, files=files, depth_sense=depth_sense, is_ordered=self.is_ordered and axes in ("none", "uv")
        )

    def transpose(self) -> ViewFiles:
        """Transposes the views like `LightField.transpose`."""
        return replace(self, files=self.files.T, is_ordered=False)

    def __getitem__(self, view: View) -> Pixels:
        """Returns view (v, u), `(H, W, C)`, which stays in memory. Raises like `Decoder.keep`."""
        return self.decoder.keep(self.files[view])

    def take(self, views: Sequence[View]) -> list[Pixels]:
        """Returns these views, which are not needed again. Raises like `Decoder.decode`."""
        with ThreadPoolExecutor(count_threads()) as pool:
            return list(pool.map(lambda view: self.decoder.take(str(self.files[view])), views))

    def is_transparent(self, views: Iterable[View]) -> bool:
        """Returns whether there is an alpha channel that is not fully opaque everywhere in `views`."""
        has_alpha = self.shape[4] in (2, 4)
        return has_alpha and not all((self[view][..., -1] == np.iinfo(self.dtype).max).all() for view in views)

    def load(self) -> LightField:
        """Loads all views into memory. Raises like `Decoder.decode`, and `TooLarge` over `limits.set_bytes`."""
        sample = self.decoder.keep(self.some)
        self.decoder.check_size(self.files.size, sample)
        views = np.empty((self.files.size, *sample.shape), sample.dtype)

        def fill(index: int) -> None:
            views[index] = self.decoder.take(str(self.files.flat[index]))

        with ThreadPoolExecutor(count_threads()) as pool:
            try:
                for _ in pool.map(fill, range(len(views))):
                    pass
            finally:
                pool.shutdown(cancel_futures=True)
        views = views.reshape(*self.files.shape, *sample.shape)
        return LightField(views, self.notes, self.is_ordered, self.depth_sense)


def count_threads() -> int:
    """Returns one thread for each core, and at least two, because a decoder releases the interpreter."""
    return max(2, count_available_cores())


def _describe(shape: tuple[int, ...], dtype: np.dtype[np.uint8] | np.dtype[np.uint16]) -> str:
    height, width, channels = shape
    return f"{height}x{width} pixels of {channels} x {8 * dtype.itemsize} bit"
