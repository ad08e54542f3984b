"""Casts rays into a scene with Embree, and shades what they hit."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from ciir.renderer.backends.reverses import find_reverses
from ciir.renderer.backends.textures import sample_texture
from ciir.renderer.scene import SOLID
from ciir.renderer.shading import encode_srgb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.scene import Scene

    Hits = tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]
    """Triangle, u, v, distance and side, as `PreparedScene._find_hits` returns them."""

MAX_LAYERS = 64
"""Most cut-out or see-through surfaces, and hidden backs, that one ray may pass; it ends there, with a note."""
HIDDEN = 1 / 8192
"""Share of the light from behind at which a ray ends: smaller shares change no 8-bit value by a thirtieth."""
EXTENT = 100.0
"""Half the scene's longest side in Embree's coordinates: its float32 tests lose digits on tiny triangles."""
STEP = 4e-6 * EXTENT
"""Distance behind a passed point at which a ray continues: about 50 spacings of float32 at `EXTENT`."""
ROUNDING = 1e-6
"""How far an alpha in float32 may fall below that of its triangle's corners when all three have the same alpha."""
PASSED = (
    f"raytrace: some rays pass more than {MAX_LAYERS} cut-out or see-through surfaces, and end there; what lies behind "
    "is not drawn"
)


class PreparedScene:
    """All parts of a scene in one Embree scene, with the colours of their surfaces."""

    def __init__(self, scene: Scene, *, whole_lines: bool = True) -> None:
        """`whole_lines`: whether rays also hit what lies in front of their origins; they then begin in front of the
        array.
        """
        parts = scene.parts
        first = np.cumsum([0] + [len(part.vertices) for part in parts])
        self.textures = [part.texture for part in parts]
        vertices = np.concatenate([part.vertices for part in parts])  # (n, 3)
        # Embree's scene is centred and scaled so that neither size nor distance costs float32 digits.
        low, high = scene.bounds()
        self._middle, self._scale = (low + high) / 2, 2 * EXTENT / max(float((high - low).max()), 1e-300)
        self._radius = float(np.linalg.norm(high - low)) / 2
        self._first = 0.0 if high[2] < 0 or not whole_lines else -np.inf
        self.passed = 0
        """Number of rays that ended at `MAX_LAYERS`."""
        self.faces = np.concatenate([part.faces + first[i] for i, part in enumerate(parts)]).astype(np.int32)  # (m, 3)
        self.colors = np.concatenate([part.colors for part in parts])  # (n, 4)
        self._parts = parts
        self._has_backs = any(part.hides_back or part.back_colors is not None for part in parts)
        self.uv = np.concatenate(
            [np.zeros((len(part.vertices), 2), np.float32) if part.uv is None else part.uv for part in parts]
        )  # (n, 2)
        self.part = np.repeat(np.arange(len(parts)), [len(part.faces) for part in parts])  # (m,)
        self.cutoff = np.array([part.alpha_cutoff or 0.0 for part in parts]) - ROUNDING  # (parts,)
        self.is_see_through = np.array([part.is_see_through for part in parts])  # (parts,)
        self._hides_back = np.array([part.hides_back for part in parts])  # (parts,)
        self._is_linear = np.array([part.is_linear for part in parts])  # (parts,)
        self._lets_through = bool(self.is_see_through.any() or (self.cutoff > 0).any())
        self._embree = EmbreeScene()
        self._vertices = vertices
        self._mesh = TriangleMesh(self._embree, self._to_embree(vertices), self.faces)
        # The first run commits the scene, which must not happen in several threads at once. This ray leads away.
        self._embree.run(np.full((1, 3), 2 * EXTENT, np.float32), np.ones((1, 3), np.float32), output=1)

    def _to_embree(self, points: NDArray[np.float64]) -> NDArray[np.float32]:
        """Returns points of the scene `(n, 3)` in Embree's coordinates."""
        placed: NDArray[np.float32] = ((points - self._middle) * self._scale).astype(np.float32)
        return placed

    def _find_hits(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """Returns the triangle of each ray's first hit or -1, its barycentric coordinates u and v there, its distance,
        and whether it is on the back, `(n,)` each. Rays pass through hidden backs. Other threads can run meanwhile.
        """
        found = self._run(origins, directions)
        if not self._hides_back.any():
            return found
        onward = self._turn_to_fronts(found, self._find_hidden(found))
        for _ in range(MAX_LAYERS):
            if not len(onward):
                return found
            passed = found[3][onward] + np.float32(STEP)
            along = directions[onward]
            hit = self._run(origins[onward] + passed[:, None] * along, along)
            for values, new in zip(found, hit, strict=True):
                values[onward] = new
            found[3][onward] += passed
            onward = self._turn_to_fronts(found, onward[self._find_hidden(hit)])
        found[0][onward] = -1
        self.passed += len(onward)
        return found

    def _run(self, origins: NDArray[np.float32], directions: NDArray[np.float32]) -> Hits:
        """Returns the first hits as `_find_hits` does, but those on hidden backs too."""
        hit = self._embree.run(origins, directions, output=1)
        if self._has_backs:
            is_back = np.einsum("nk,nk->n", hit["Ng"], directions) > 0
        else:
            is_back = np.zeros(len(origins), np.bool_)
        return hit["primID"], hit["u"], hit["v"], hit["tfar"], is_back

    def _find_hidden(self, hits: Hits) -> NDArray[np.intp]:
        """Returns the rays that hit a hidden back."""
        triangle, *_, is_back = hits
        if not is_back.any():  # the usual case: the object is closed
            return np.flatnonzero(is_back)
        back = np.flatnonzero(is_back & (triangle >= 0))
        hidden: NDArray[np.intp] = back[self._hides_back[self.part[triangle[back]]]]
        return hidden

    @cached_property
    def _back(self) -> NDArray[np.float32]:
        """The colours of the backs, `(n, 4)`."""
        rgb = [part.colors[:, :3] if part.back_colors is None else part.back_colors for part in self._parts]
        return np.concatenate([np.concatenate(rgb), self.colors[:, 3:]], axis=1)

    @cached_property
    def _fronts(self) -> tuple[NDArray[np.intp], NDArray[np.int32]]:
        return find_reverses(self._vertices, self.faces)

    def _turn_to_fronts(self, found: Hits, hidden: NDArray[np.intp]) -> NDArray[np.intp]:
        """Replaces the hits `hidden` of `found`, on backs, by fronts at the same places; returns those without a
        front.
        """
        if not len(hidden):
            return hidden
        place, fronts = self._fronts
        triangle, u, v, _, is_back = found
        front = fronts[triangle[hidden]]
        met, new = hidden[front >= 0], front[front >= 0]
        is_same = place[self.faces[new]][:, :, None] == place[self.faces[triangle[met]]][:, None, :]  # (n, 3, 3)
        weights = np.einsum("nij,nj->ni", is_same, _weigh_corners(u[met], v[met]))
        triangle[met], u[met], v[met], is_back[met] = new, weights[:, 1], weights[:, 2], False
        return hidden[front < 0]

    def _enter(
        self, origins: NDArray[np.float64], direction: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32], NDArray[np.float32]]:
        """Returns where rays start, as multiples of `direction` `(n,)` and in Embree's coordinates `(n, 3)`; and
        directions.

        They start where they enter the sphere around the scene, because float32 aims less exactly from farther away.
        """
        axes = list(zip(origins.T, direction.T, self._middle, strict=True))  # by axis: rows of 3 are slow in NumPy
        squared = sum(along**2 for _, along, _ in axes)
        entry = sum((middle - start) * along for start, along, middle in axes) / squared
        entry = np.maximum(entry - self._radius / np.sqrt(squared), self._first)
        entries = np.empty(origins.shape, np.float32)
        for axis, (start, along, middle) in enumerate(axes):
            entries[:, axis] = (start + entry * along - middle) * self._scale
        return entry, entries, np.broadcast_to(direction.astype(np.float32), entries.shape)

    def meet(
        self, origins: NDArray[np.float64], direction: NDArray[np.float64]
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Returns the triangle that each ray hits first, or -1, `(n,)`, and the weights of its corners there `(n, 3)`.

        `origins`, `direction`: as in `cast`. Cut-out and see-through triangles count too.
        """
        _, entries, along = self._enter(origins, direction)
        triangle, u, v, *_ = self._find_hits(entries, along)
        return triangle, _weigh_corners(u, v)

    def cast(
        self, origins: NDArray[np.float64], direction: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Returns the colour and the distance of what each ray hits.

        `origins`: `(n, 3)`, `direction`: `(3,)` or `(n, 3)`, in the scene's coordinates. See-through surfaces are
        blended front to back ("over", Porter and Duff, SIGGRAPH 1984). A surface closer than `STEP` behind a point that
        a ray passes is passed with it.

        Returns RGBA `(n, 4)` in [0, 1], RGB times alpha, all zero if a ray hits nothing; and the distances `(n,)` of
        the first points with alpha of at least `SOLID`, as multiples of `direction`, +inf if there is none.
        """
        entry, entries, along = self._enter(origins, direction)
        rgba = np.zeros((len(origins), 4), np.float32)
        reached = np.full(len(origins), np.inf, np.float32)  # from the entry, in Embree's units
        if not self._lets_through:  # the usual case, in one pass
            triangle, u, v, distance, is_back = self._find_hits(entries, along)
            hit = np.flatnonzero(triangle >= 0)
            rgba[hit] = self._shade(triangle[hit], _weigh_corners(u[hit], v[hit]), is_back[hit])[0]
            reached[hit] = distance[hit]
            return rgba, entry + reached / self._scale
        starts, passed = entries, np.zeros(len(origins), np.float32)
        through = np.ones(len(origins), np.float32)  # share of the light from behind that comes through
        active, last = np.arange(len(origins)), np.full(len(origins), -1)
        for _ in range(MAX_LAYERS):
            triangle, u, v, distance, is_back = self._find_hits(starts, along)
            hit = np.flatnonzero(triangle >= 0)
            color, alpha = self._shade(triangle[hit], _weigh_corners(u[hit], v[hit]), is_back[hit])
            alpha[triangle[hit] == last[hit]] = 0.0  # met again by rounding
            ray = active[hit]
            rgba[ray] += (through[ray] * alpha)[:, None] * color
            through[ray] *= 1 - alpha
            is_first = (alpha >= SOLID - ROUNDING) & (reached[ray] == np.inf)
            reached[ray[is_first]] = (passed[hit] + distance[hit])[is_first]
            onward = hit[through[ray] > HIDDEN]
            if not len(onward):
                break
            passed = passed[onward] + distance[onward] + np.float32(STEP)
            active, last = active[onward], triangle[onward]
            entries, along = entries[onward], along[onward]
            starts = entries + along * passed[:, None]
        else:
            self.passed += len(active)
        return rgba, entry + reached / self._scale

    def cast_levels(self, origins: NDArray[np.float64], direction: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Returns the colours of `cast` in whole levels, `(n, 4)`, rounded to nearest."""
        if self._lets_through:
            return (self.cast(origins, direction)[0] * 255.0 + 0.5).astype(np.uint8)
        _, entries, along = self._enter(origins, direction)
        triangle, u, v, _, is_back = self._find_hits(entries, along)
        hit = np.flatnonzero(triangle >= 0)
        color = self._shade(triangle[hit], _weigh_corners(u[hit], v[hit]), is_back[hit])[0] * 255.0 + 0.5
        levels = np.zeros(len(origins), np.uint32)  # whole RGBA: faster to scatter
        levels[hit] = color.astype(np.uint8).view(np.uint32).ravel()
        return levels.view(np.uint8).reshape(-1, 4)

    def _shade(
        self, triangle: NDArray[np.int32], weights: NDArray[np.float32], is_back: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Returns RGBA of hits `(n, 4)`, with alpha 1, and the share of what is behind them that they hide, `(n,)`."""
        corners = self.faces.take(triangle, axis=0)  # (n, 3)
        product = np.einsum("nk,nkc->nc", weights, self.colors.take(corners, axis=0))  # (n, 4)
        if is_back.any():
            product[is_back] = np.einsum("nk,nkc->nc", weights[is_back], self._back[corners[is_back]])
        part = self.part.take(triangle)
        if self._is_linear.any():
            linear = self._is_linear[part]
            product[linear, :3] = encode_srgb(product[linear, :3])
        for index in np.flatnonzero(np.bincount(part)):
            texture = self.textures[index]
            if texture is None:
                continue
            if len(self.textures) == 1:
                product *= sample_texture(texture, np.einsum("nk,nkc->nc", weights, self.uv.take(corners, axis=0)))
                continue
            of_part = np.flatnonzero(part == index)
            uv = np.einsum("nk,nkc->nc", weights[of_part], self.uv.take(corners[of_part], axis=0))
            product[of_part] *= sample_texture(texture, uv)
        np.clip(product, 0.0, 1.0, out=product)
        if self._lets_through:
            alpha = np.where(self.is_see_through[part], product[:, 3], product[:, 3] >= self.cutoff[part])
        else:
            alpha = np.ones(len(product), np.float32)
        product[:, 3] = 1.0
        return product, alpha


def _weigh_corners(u: NDArray[np.float32], v: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns the weights of a triangle's corners `(n, 3)` at barycentric coordinates `(n,)`."""
    weights = np.empty((len(u), 3), np.float32)
    np.subtract(1 - u, v, out=weights[:, 0])
    weights[:, 1], weights[:, 2] = u, v
    return weights
