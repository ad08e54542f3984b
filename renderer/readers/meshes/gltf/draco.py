"""Draco-compressed primitives (KHR_draco_mesh_compression)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ciir.errors import Unreadable

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ciir.renderer.readers.meshes.gltf.document import Document


def decode_draco(document: Document, extension: dict[str, Any]) -> tuple[NDArray[np.int64], dict[str, NDArray[Any]]]:
    """A Draco-compressed primitive: faces `(m, 3)`, and `(n, width)` for each attribute that it compresses.

    Raises `Unreadable` where it is corrupt.
    """
    import DracoPy

    try:
        mesh = DracoPy.decode(bytes(document.view(extension["bufferView"])))
    except (DracoPy.FileTypeException, RuntimeError, ValueError) as error:
        raise Unreadable(f"{document.name}: its Draco data is corrupt; export it again") from error
    stored = {entry["unique_id"]: np.asarray(entry["data"]) for entry in mesh.attributes}
    if getattr(mesh, "faces", None) is None:
        raise Unreadable(f"{document.name}: its Draco data holds points alone; give a mesh with a surface")
    faces = np.asarray(mesh.faces).astype(np.int64).reshape(-1, 3)
    return faces, {str(name): stored[unique] for name, unique in extension["attributes"].items()}
