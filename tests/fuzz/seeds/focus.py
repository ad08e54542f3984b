"""Seeds of forms for depth planes and disparity maps."""

from __future__ import annotations


def _make_forms(*asked: dict[str, str]) -> list[bytes]:
    head = b'--bound\r\nContent-Disposition: form-data; name="%b"%b\r\n\r\n%b\r\n'
    file = head % (b"file", b'; filename="a.npz"', b"PK")
    return [
        b"".join([file, *(head % (name.encode(), b"", value.encode()) for name, value in fields.items())])
        + b"--bound--\r\n"
        for fields in asked
    ]


def planes() -> list[bytes]:
    """One plane, stacks of disparities and of depths, and a view in focus everywhere."""
    return _make_forms(
        {"disparity": "-0.5", "method": "delta", "aperture": "1.5", "aperture_shape": "gauss"},
        {"stack": "-1:1:3", "occluders": "remove", "model": "nearest", "scale": "2", "format": "mp4", "fps": "5"},
        {"stack": "20:40:2", "stack_of": "depths", "camera_pitch": "2", "focal_length": "36", "sensor": "36"},
        {"all_in_focus": "yes", "limits": "-1:1"},
    )


def disparities() -> list[bytes]:
    """Maps, a model, and points before cameras."""
    cameras = {"camera_pitch": "2", "focal_length": "36", "sensor": "36", "convergence": "90"}
    return _make_forms(
        {"view": "0,4", "limits": "-1:1", "format": "png"},
        {"format": "glb"},
        {"format": "zip"},
        {"format": "ply", "points": "yes", **cameras},
    )
