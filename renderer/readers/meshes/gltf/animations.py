"""glTF animations: properties of nodes at a time (glTF 2.0, section 3.11 and appendix C)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import InvalidOption, Unreadable
from ciir.renderer.readers.meshes.gltf.accessors import read_accessor
from ciir.renderer.readers.names import clean_text, find_numbered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

PATHS = {"translation": 3, "rotation": 4, "scale": 3, "weights": None}
"""The properties of nodes that can be animated, and their lengths."""
MODES = ("LINEAR", "STEP", "CUBICSPLINE")
"""The modes of interpolation."""
_STRAIGHT = 1e-6  # radians; below this angle rotations are interpolated along a straight line


def sample_nodes(document: Document, time: float, animation: str | None) -> dict[int, dict[str, Any]]:
    """Returns the properties that animations give to nodes at `time` in seconds: node -> property of `PATHS` -> value.

    `animation` is the name, or the number from 0, of the animation that is played. Without it the first one is played,
    with each later one that moves none of the same properties; the others are other sequences of the same object. A
    property keeps its first value before the first keyframe, and its last value after the last keyframe.

    Raises `InvalidOption` if there are no animations, or if that one doesn't exist.
    """
    count = len(document.json.get("animations", []))
    if not count:
        raise InvalidOption(f"time: {document.name} holds no animation; leave it out")
    entries = [document.item("animations", number) for number in range(count)]
    titles = [str(entry.get("name", "")) for entry in entries]
    numbers: Sequence[int] = range(count)
    if animation is not None:
        numbers = [find_numbered("animation", animation, [[title] for title in titles], document.name)]
    played: dict[int, dict[str, Any]] = {}
    skipped, end = [], 0.0
    for number in numbers:
        channels = _find_channels(document, entries[number])
        if any(path in played.get(node, {}) for node, path, _ in channels):
            skipped.append(clean_text(titles[number] or str(number))[:40])
            continue
        for node, path, sampler in channels:
            value, last = sample(document, sampler, path, time)
            played.setdefault(node, {})[path] = value
            end = max(end, last)
    if skipped:
        others = ", ".join(skipped[:5]) + (", ..." if skipped[5:] else "")
        document.resolver.add_note(
            f"animation: the first is played; others that move the same nodes are not ({others}); animation selects one"
        )
    if time > end:
        document.resolver.add_note(f"time: the animation ends at {end:g} s; its last pose is shown")
    return played


def _find_channels(document: Document, animation: dict[str, Any]) -> list[tuple[int, str, dict[str, Any]]]:
    """Returns the node, property and sampler of each channel."""
    found = []
    for channel in animation["channels"]:
        target = channel["target"]
        if "node" not in target or target["path"] not in PATHS:
            document.resolver.add_note("animations of anything other than nodes are not played")
            continue
        document.item("nodes", target["node"])
        if channel["sampler"] < 0:
            raise Unreadable(f"{document.name}: an animation's sampler is number {channel['sampler']}; export it again")
        found.append((target["node"], target["path"], animation["samplers"][channel["sampler"]]))
    return found


def sample(document: Document, sampler: dict[str, Any], path: str, time: float) -> tuple[NDArray[np.float64], float]:
    """Returns a sampler's value at `time`, and the time of its last keyframe. Raises `Unreadable` if it has none."""
    times = read_accessor(document, sampler["input"])[:, 0]
    values = read_accessor(document, sampler["output"])
    mode = sampler.get("interpolation", "LINEAR")
    if mode not in MODES:
        document.resolver.add_note(f"animation: interpolation {clean_text(str(mode))[:40]} is read as LINEAR")
    count, parts = len(times), 3 if mode == "CUBICSPLINE" else 1
    if not count or len(values) % (count * parts) or not np.isfinite(times).all():
        raise Unreadable(f"{document.name}: an animation's keyframes and values don't fit; export it again")
    before = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, count - 1))
    after, rows = min(before + 1, count - 1), len(values) // count
    first, second = (
        values[key * rows : (key + 1) * rows].astype(np.float64).reshape(parts, -1) for key in (before, after)
    )  # (parts, length); the parts of a spline are in-tangent, value, out-tangent
    length = first.shape[1]
    if PATHS[path] not in (None, length):
        raise Unreadable(f"{document.name}: an animated {path} has {length} numbers; export it again")
    step = float(times[after] - times[before])
    share = min(max((time - float(times[before])) / step, 0.0), 1.0) if step > 0 else 0.0
    if mode == "CUBICSPLINE":
        value = _interpolate_spline(first, second, share, step)
    elif mode == "STEP":
        value = first[0]
    elif path == "rotation":
        value = slerp(first[0], second[0], share)
    else:
        value = first[0] + share * (second[0] - first[0])
    return value, float(times[-1])


def _interpolate_spline(
    first: NDArray[np.float64], second: NDArray[np.float64], share: float, step: float
) -> NDArray[np.float64]:
    """Interpolates a cubic Hermite spline between two keyframes (appendix C.5)."""
    squared, cubed = share**2, share**3
    value: NDArray[np.float64] = (
        (2 * cubed - 3 * squared + 1) * first[1]
        + step * (cubed - 2 * squared + share) * first[2]
        + (3 * squared - 2 * cubed) * second[1]
        + step * (cubed - squared) * second[0]
    )
    return value


def slerp(first: NDArray[np.float64], second: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Returns the rotation at `share` of the shorter way between two quaternions (appendix C.4)."""
    first, second = (quaternion / max(float(np.linalg.norm(quaternion)), 1e-300) for quaternion in (first, second))
    cosine = float(first @ second)
    if cosine < 0:
        second, cosine = -second, -cosine
    angle = np.arccos(min(cosine, 1.0))
    if angle < _STRAIGHT:
        return first + share * (second - first)
    turned: NDArray[np.float64] = (np.sin((1 - share) * angle) * first + np.sin(share * angle) * second) / np.sin(angle)
    return turned
