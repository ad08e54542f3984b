"""glTF skins: vertices that follow several joints (glTF 2.0, section 3.7.3.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable
from ciir.renderer.readers.meshes.gltf.accessors import read_accessor

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document

_VERTICES_PER_BATCH = 1 << 16


def find_joint_matrices(
    document: Document, index: object, world: Mapping[int, NDArray[np.float64]]
) -> NDArray[np.float64] | None:
    """Returns matrices `(joints, 4, 4)` from the skin's mesh as it was modelled to where each joint moves it.

    `world` holds the matrices of the scene's nodes. Returns None, with a note, if a joint is not one of them.
    """
    skin = document.item("skins", index)
    joints = skin["joints"]
    if not all(joint in world for joint in joints):
        document.resolver.add_note("a skin's joints are not in the scene: its mesh is drawn as it was modelled")
        return None
    placed = np.array([world[joint] for joint in joints]).reshape(-1, 4, 4)
    if "inverseBindMatrices" not in skin:
        return placed
    inverse = read_accessor(document, skin["inverseBindMatrices"])
    if inverse.shape[1] != 16 or len(inverse) < len(joints):
        raise Unreadable(f"{document.name}: skin {index} lacks inverse bind matrices; export it again")
    bound: NDArray[np.float64] = placed @ inverse[: len(joints)].astype(np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
    return bound


def bend(
    vertices: NDArray[np.float64],
    normals: NDArray[np.float64] | None,
    joints: NDArray[Any],
    weights: NDArray[Any],
    matrices: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64] | None, bool]:
    """Moves vertices and normals `(n, 3)` by the weighted mean of the matrices `(m, 4, 4)` of their joints `(n, k)`.

    Weights `(n, k)` are scaled to a sum of 1; a vertex without weights follows its first joint. Normals are transformed
    by the cofactors. Also returns whether most vertices are mirrored, which reverses the winding of faces.
    """
    if joints.shape != weights.shape or joints.max(initial=0) >= len(matrices):
        raise IndexError("a vertex names a joint that is not there")
    weights = np.maximum(weights.astype(np.float64), 0)
    total = weights.sum(axis=1, keepdims=True)
    weights = np.divide(weights, total, out=np.zeros_like(weights), where=total > 0)
    weights[total[:, 0] <= 0, 0] = 1
    moved, turned = np.empty_like(vertices), None if normals is None else np.empty_like(normals)
    mirrored = 0
    for start in range(0, len(vertices), _VERTICES_PER_BATCH):
        batch = slice(start, start + _VERTICES_PER_BATCH)
        mean = np.einsum("nk,nkij->nij", weights[batch], matrices[joints[batch], :3])  # (batch, 3, 4)
        linear = mean[:, :, :3]
        moved[batch] = np.einsum("nij,nj->ni", linear, vertices[batch]) + mean[:, :, 3]
        is_mirrored = np.linalg.det(linear) < 0
        mirrored += int(is_mirrored.sum())
        if normals is not None and turned is not None:
            cofactors = np.cross(linear[:, [1, 2, 0]], linear[:, [2, 0, 1]])  # (n, 3, 3)
            sign = np.where(is_mirrored, -1.0, 1.0)[:, None]
            turned[batch] = np.einsum("nij,nj->ni", cofactors, normals[batch]) * sign
    return moved, turned, 2 * mirrored > len(vertices)
