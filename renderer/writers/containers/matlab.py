"""Writes `LF[j, i, l, k, c]` of the Light Field Toolbox in MAT versions 5 and 7.3, and files of the old HCI data set.

All three count cameras: a light field with the depth sense of lenses is written with its views reversed in v and u.
"""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import h5py
import numpy as np

from ciir.errors import InvalidOption
from ciir.renderer.writers.whole import WholeWriter

if TYPE_CHECKING:
    from ciir.renderer.light_field import LightField
    from ciir.renderer.writers.writer import Contents

_HEADER = 116
"""Bytes of text at the start of a MAT file."""
_USER_BLOCK = 512

_UNKNOWN = "hci: the distance of cameras and the focus are not known: dH, dV and focalLength are 1, shift is 0"


class CameraWriter(WholeWriter):
    """The base class of writers of an array that has no alpha and counts cameras."""

    sense = "cameras"
    holds_alpha = False


class MatWriter(CameraWriter):
    """Writes `LF` in MAT version 5."""

    def check(self, contents: Contents) -> None:
        """Refuses views that don't fit into the format's 32-bit sizes."""
        size = len(contents.views) * contents.height * contents.width * contents.channels * contents.dtype.itemsize
        if size >= 2**31:
            raise InvalidOption(f"format: mat holds less than 2 GiB and the views have {size:,} bytes; give mat73")

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the views; the header's text has no date, so that the same views make the same bytes."""
        from scipy.io import savemat

        savemat(self.file, {"LF": light_field.views})
        self.file.seek(0)
        self.file.write(b"MATLAB 5.0 MAT-file, written by ciir".ljust(_HEADER))
        self.file.seek(0, io.SEEK_END)
        return []


class Mat73Writer(CameraWriter):
    """Writes `LF` in MAT version 7.3, which is HDF5 with axes counted from the other end."""

    def encode(self, light_field: LightField) -> list[str]:
        """Writes the views; MATLAB reads the class from an attribute, and the version from the block before the HDF5
        file.
        """
        packed = io.BytesIO()
        with h5py.File(packed, "w", userblock_size=_USER_BLOCK) as file:
            dataset = file.create_dataset("LF", data=light_field.views.T)
            dataset.attrs["MATLAB_class"] = np.bytes_(light_field.dtype.name)
        header = b"MATLAB 7.3 MAT-file, written by ciir".ljust(_HEADER) + bytes(8) + b"\x00\x02IM"
        self.file.write(header.ljust(_USER_BLOCK, b"\0"))
        self.file.write(packed.getbuffer()[_USER_BLOCK:])
        return []


class HciWriter(CameraWriter):
    """Writes `LF[v, U-1-u, y, x, c]` with the attributes of the old HCI data set."""

    def encode(self, light_field: LightField) -> list[str]:
        """Writes views from right to left, and attributes; notes the attributes that are not known."""
        rows, columns, height, width, channels = light_field.shape
        packed = io.BytesIO()
        with h5py.File(packed, "w") as file:
            file.create_dataset("LF", data=light_field.views[:, ::-1])
            sizes = {"vRes": rows, "hRes": columns, "yRes": height, "xRes": width, "channels": channels}
            unknown = {"dH": 1.0, "dV": 1.0, "focalLength": 1.0, "shift": 0.0, "vSampling": 1.0, "hSampling": 1.0}
            file.attrs.update(sizes | unknown)
        self.file.write(packed.getbuffer())
        return [_UNKNOWN]
