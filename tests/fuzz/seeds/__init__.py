"""Small valid inputs of every format, made by our own encoders or written here: the seeds of fuzzing.

A seed of several files holds them joined by `BETWEEN` (`pack`, `parts`), so that a fuzzer changes their content
without having to write a zip.
"""

from __future__ import annotations

import io
import struct
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import tifffile
from PIL import Image

from ciir.renderer.readers.metadata.exif import ORIENTATION
from ciir.renderer.writers.pictures import encode_png
from ciir.renderer.writers.pictures.jpeg import encode as encode_jpeg
from ciir.renderer.writers.pictures.tiff import encode as encode_tiff
from ciir.service.pipeline.options import NAMES
from tests.support.inputs import make_netpbm, make_profile, make_zip

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

BETWEEN = b"\n=====\n"
BOUNDARY = b"bound"
CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 1)]
FACES = [(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)]


def pack(*files: bytes) -> bytes:
    """Several files as one input."""
    return BETWEEN.join(files)


def parts(data: bytes) -> list[bytes]:
    """What `pack` packed; at least one file."""
    return data.split(BETWEEN)


def noise(height: int, width: int, channels: int, dtype: type = np.uint8) -> NDArray[Any]:
    """`(height, width, channels)`, the same each time."""
    return np.random.default_rng(height).integers(0, np.iinfo(dtype).max, (height, width, channels), dtype)


def zipped(files: Mapping[str, bytes], kind: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip, the same each time."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", kind) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data, kind)
    return buffer.getvalue()


def saved(image: Image.Image, form: str, **options: Any) -> bytes:
    """A file as Pillow writes it."""
    buffer = io.BytesIO()
    image.save(buffer, form, **options)
    return buffer.getvalue()


def turned_exif() -> Image.Exif:
    """An Exif block of a picture that lies on its side."""
    exif = Image.Exif()
    exif[ORIENTATION] = 6
    return exif


def png() -> list[bytes]:
    """Every colour type; 1, 8 and 16 bit; a palette and a transparent colour; an orientation."""
    kinds = [encode_png(noise(6, 6, n, dtype)) for n in (1, 2, 3, 4) for dtype in (np.uint8, np.uint16)]
    rgb = Image.fromarray(noise(6, 6, 3))
    return [
        *kinds,
        saved(rgb.convert("P"), "PNG", transparency=3),
        saved(rgb.convert("1"), "PNG"),
        saved(rgb, "PNG", transparency=(1, 2, 3)),
        saved(rgb, "PNG", exif=turned_exif(), icc_profile=make_profile("P3")),
    ]


def jpegs() -> list[bytes]:
    """Grey and colour, baseline and progressive, with an orientation."""
    rgb = Image.fromarray(noise(16, 16, 3))
    return [
        encode_jpeg(noise(16, 16, 1)[..., 0]),
        encode_jpeg(noise(16, 16, 3)),
        saved(rgb, "JPEG", progressive=True, subsampling=2),
        saved(rgb, "JPEG", exif=turned_exif(), icc_profile=make_profile("P3")),
    ]


def webps() -> list[bytes]:
    """With and without loss, with alpha, and with an orientation."""
    rgb, rgba = (Image.fromarray(noise(16, 16, channels)) for channels in (3, 4))
    plain = [saved(rgb, "WEBP"), saved(rgb, "WEBP", lossless=True), saved(rgba, "WEBP")]
    return [*plain, saved(rgb, "WEBP", exif=turned_exif(), icc_profile=make_profile("P3"))]


def netpbms() -> list[bytes]:
    """Grey and colour, 8 and 16 bit, with levels that are stored as they are and with others."""
    whites = (255, 65535, 1023, 1, 1000)
    return [
        make_netpbm(noise(6, 6, channels, np.uint32) % (white + 1), white) for channels in (1, 3) for white in whites
    ]


def bmps() -> list[bytes]:
    """Grey, RGB, a palette, and black and white."""
    rgb = Image.fromarray(noise(6, 6, 3))
    return [saved(image, "BMP") for image in (rgb.convert("L"), rgb, rgb.convert("P"), rgb.convert("1"))]


def tiffs() -> list[bytes]:
    """8 and 16 bit, the compressions that are read, strips and tiles, planes apart, both byte orders."""
    written = [encode_tiff(noise(16, 16, n, dtype)) for n in (2, 3, 4) for dtype in (np.uint8, np.uint16)]
    for more in (
        {"compression": "lzw"},
        {"compression": "packbits"},
        {"tile": (16, 16)},
        {"planarconfig": "separate"},
        {"byteorder": ">", "bigtiff": True},
    ):
        buffer = io.BytesIO()
        pixels = noise(16, 16, 3)
        pixels = pixels.transpose(2, 0, 1) if "planarconfig" in more else pixels
        tifffile.imwrite(buffer, pixels, photometric="rgb", metadata=None, software=False, **more)
        written.append(buffer.getvalue())
    return written


def off() -> list[bytes]:
    """Plain, and with colours."""
    faces = "\n".join("3 " + " ".join(map(str, face)) for face in FACES)
    plain = "\n".join(" ".join(map(str, corner)) for corner in CORNERS)
    colored = "\n".join(" ".join(map(str, (*corner, 255, 128, 0, 255))) for corner in CORNERS)
    return [f"OFF\n4 4 0\n{plain}\n{faces}\n".encode(), f"COFF\n# a comment\n4 4 6\n{colored}\n{faces}\n".encode()]


def stl() -> list[bytes]:
    """ASCII and binary."""
    triangles = [[CORNERS[i] for i in face] for face in FACES]
    text = "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join("vertex {} {} {}\n".format(*c) for c in t) + "endloop\nendfacet\n"
        for t in triangles
    )
    binary = b"".join(struct.pack("<12fH", 0, 0, 0, *(x for c in t for x in c), 0) for t in triangles)
    return [f"solid a\n{text}endsolid a\n".encode(), bytes(80) + struct.pack("<I", len(triangles)) + binary]


def ply() -> list[bytes]:
    """ASCII, and binary in both byte orders; colours, normals, mixed faces, a texture; faces of two textures."""
    head = "ply\nformat {} 1.0\ncomment TextureFile x.png\nelement vertex 4\n"
    head += "".join(f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz", "s", "t"))
    head += "property uchar red\nproperty uchar green\nproperty uchar blue\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [(*map(float, corner), 0.0, 0.0, 1.0, 0.5, 0.5, 255, 128, 0) for corner in CORNERS]
    body = "\n".join(" ".join(map(str, row)) for row in rows) + "\n3 0 1 2\n4 0 1 2 3\n"
    picture = encode_png(noise(4, 4, 3))
    written = [pack((head.format("ascii") + body).encode(), picture)]
    for name, order in (("binary_little_endian", "<"), ("binary_big_endian", ">")):
        data = b"".join(struct.pack(order + "8f3B", *row) for row in rows)
        data += struct.pack(order + "B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)
        written.append(pack(head.format(name).encode() + data, picture))
    head = "ply\nformat ascii 1.0\ncomment TextureFile y.png\ncomment TextureFile x.png\nelement vertex 4\n"
    head += "".join(f"property float {n}\n" for n in "xyz") + "element face 2\nproperty list uchar int vertex_indices\n"
    head += "property list uchar float texcoord\nproperty int texnumber\nend_header\n"
    body = "\n".join("{} {} {}".format(*corner) for corner in CORNERS)
    body += "\n3 0 1 2 6 0 0 1 0 1 1 0\n4 0 1 2 3 8 0 0 1 0 1 1 0 1 1\n"
    return [*written, pack((head + body).encode(), picture)]


def dae() -> list[bytes]:
    """A COLLADA file with polygons, a texture, and a node that is instanced; and the texture."""
    return [pack((Path(__file__).parent / "seed.dae").read_bytes(), encode_png(noise(4, 4, 3)))]


def threemf() -> list[bytes]:
    """A 3MF of one coloured triangle, which is drawn twice."""
    model = (
        b"<model xmlns='http://schemas.microsoft.com/3dmanufacturing/core/2015/02'><resources>"
        b"<basematerials id='9'><base name='a' displaycolor='#FF0000'/></basematerials>"
        b"<object id='1' pid='9' pindex='0'>"
        b"<mesh><vertices><vertex x='0' y='0' z='0'/><vertex x='2' y='0' z='0'/><vertex x='0' y='0' z='3'/></vertices>"
        b"<triangles><triangle v1='0' v2='1' v3='2'/></triangles></mesh></object></resources>"
        b"<build><item objectid='1'/><item objectid='1' transform='1 0 0 0 1 0 0 0 1 5 0 0'/></build></model>"
    )
    files = {"[Content_Types].xml": b"<Types/>", "_rels/.rels": b"<Relationships/>", "3D/3dmodel.model": model}
    return [make_zip(files)]


def obj() -> list[bytes]:
    """An OBJ, its MTL and a texture."""
    text = b"mtllib a.mtl\n" + b"".join(b"v %d %d %d 1 0.5 0\n" % corner for corner in CORNERS)
    text += b"vt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\nusemtl m\nf 1/1/1 2/2/1 3/3/1\nusemtl n\nf -4//1 -2//1 -1//1\nl 1 2\n"
    library = b"newmtl m\nKd 1 0.5 0\nmap_Kd -clamp on -s 1 1 1 x.png\nmap_d x.png\nnewmtl n\nKd 0\n"
    return [pack(text, library, encode_png(noise(4, 4, 4)))]


def zips() -> list[bytes]:
    """A mesh with its files, stored and packed; views; a folder in it; hidden files."""
    text, library, picture = parts(obj()[0])
    mesh = {"a/main.obj": text, "a/a.mtl": library, "a/x.png": picture, "__MACOSX/a": b"x", ".hidden": b""}
    views = {f"view_{n // 2:02d}_{n % 2:02d}.png": picture for n in range(4)}
    return [zipped(mesh), zipped(mesh, zipfile.ZIP_STORED), zipped(views | {"notes.txt": b"x"}), zipped({})]


def view_sets() -> list[bytes]:
    """The names of views, one a line, and their pictures."""
    small = encode_png(noise(4, 4, 3))
    names = (
        b"view_00_00.png\nview_00_01.png\nview_01_00.png\nview_01_01.png",
        b"out_00_00_-1.5_2.0_.png\nout_00_01_0_0.png\nout_01_00_0_0.png\nout_01_01_0_0.png",
        b"input_Cam000.png\ninput_Cam001.png\ninput_Cam002.png\ninput_Cam003.png",
        b"a.png\nb.png\nc.png\nd.png",
        b"7_x0_y0.png\n7_x1_y0.png\n7_x0_y1.png\n7_x1_y1.png",
        b"IMG_0008.png\nIMG_0009.png\nIMG_0010.png\nIMG_0011.png",
    )
    return [pack(listed, small, small, small, small) for listed in names]


def options() -> list[bytes]:
    """The options' values, one a line by the order of `service.pipeline.options.NAMES`; an empty line leaves one
    out."""
    asked: list[dict[str, str]] = [
        {"lenses": "6x9", "views": "center", "model": "none", "scale": "2"},
        {"lenses": "6x9", "pixels": "4x4", "views": "0,0;1,1;3,3", "model": "bicubic", "scale": "3"},
        {"pixels": "4x4", "views": "cross", "model": "nearest", "strategy": "upscale", "skip": "none"},
        {"lenses": "6x9", "views": "all", "model": "none", "pickup": "optical"},
        {
            "lenses": "6x9",
            "pixels": "3x3",
            "views": "1,1",
            "backend": "raytrace",
            "sampling": "lenslet",
            "delta": "0.1",
        },
        {"lenses": "6x9", "pixels": "4x4", "strategy": "direct", "background": "ff8000"},
        {"lenses": "6x9", "pixels": "4x4", "model": "fast", "pitch": "1e-3"},
        {"lenses": "6x9", "pixels": "4x4", "model": "none", "up": "z", "rotate": "30,-20,5.5", "place": "0.5"},
        {"lenses": "6x9", "pixels": "4x4", "model": "none", "zoom": "9", "light": "-90,45", "parallax": "60"},
        {
            "lenses": "6x9",
            "model": "none",
            "arrangement": "mosaic",
            "order": "columns",
            "flip": "uv",
            "transpose": "yes",
            "depth_sense": "lenses",
        },
        {"pixels": "4x4", "model": "none", "crop": "4,4,4,0"},
        {"lens_pitch": "8.5", "model": "none"},
    ]
    return ["\n".join(one.get(name, "") for name in NAMES).encode() for one in asked]


def repeating() -> list[bytes]:
    """A picture with a period, as an elemental image array has."""
    tile = np.random.default_rng(1).integers(0, 256, (9, 8, 3), np.uint8)
    return [encode_png(np.tile(tile, (8, 9, 1)))]


def multipart() -> list[bytes]:
    """Forms with the boundary `BOUNDARY`: whole, with empty fields, names of RFC 5987 and RFC 2047, a shipped scene."""
    head = b'--bound\r\nContent-Disposition: form-data; name="%b"%b\r\n\r\n%b\r\n'
    file = head % (b"file", b'; filename="a.off"\r\nContent-Type: application/octet-stream', off()[0])
    fields = head % (b"lenses", b"", b"4x4") + head % (b"views", b"", b"0,0;1,1") + head % (b"format", b"", b"npz")
    encoded = head % (b"file", b"; filename*=UTF-8''%e2%82%ac.obj; filename=\"=?utf-8?q?a?=.obj\"", b"v 0 0 0\n")
    return [
        file + fields + b"--bound--\r\n",
        fields + head % (b"model", b"", b"") + file + b"--bound--\r\nepilogue",
        encoded + b"--bound--",
        head % (b"scene", b"", b"vase") + fields + b"--bound--\r\n",
    ]
