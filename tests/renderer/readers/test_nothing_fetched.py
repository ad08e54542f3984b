"""Addresses in a mesh file are never followed: readers take files from the bundle only.

The readers run in a process of their own, in which an audit hook records each opening of a file, socket or process.
"""

import subprocess
import sys

from tests.support.paths import ROOT

CODE = r"""
import base64, json, struct, sys
from pathlib import Path
from xml.sax.saxutils import escape

from ciir.renderer.writers.pictures import encode, encode_png
from ciir.renderer.readers import inputs, pictures
from ciir.renderer.readers.bundle import Bundle
from ciir.errors import InputError

import numpy as np

ADDRESSES = (
    "http://127.0.0.1:9/x.png", "https://example.org/x.png", "ftp://example.org/x.png", "file:///etc/passwd",
    "file://localhost/etc/passwd", "//example.org/share/x.png", r"\\example.org\share\x.png", "/etc/passwd",
    "../../../../etc/passwd", "..\\..\\etc\\passwd", "C:\\Windows\\win.ini", "~/.ssh/id_rsa", "/dev/stdin", "smb://h/x.png",
    "x.png\0.gltf", "javascript:alert(1)", "data:text/plain,x", "%2e%2e%2f%2e%2e%2fetc%2fpasswd",
)
CORNERS = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
UV = struct.pack("<6f", 0, 0, 1, 0, 0, 1)
OBJ = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n"
PLY = (
    "ply\nformat ascii 1.0\ncomment TextureFile {}\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nproperty float s\nproperty float t\nelement face 1\nproperty list uchar int vertex_indices\n"
    "end_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n"
)

DAE = Path("tests/fuzz/seeds/seed.dae").read_text()


def gltf(buffer, image):
    embedded = "data:;base64," + base64.b64encode(CORNERS + UV).decode()
    return json.dumps({
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": image}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"},
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
        "buffers": [{"uri": buffer or embedded, "byteLength": 60}],
    }).encode()


def files(address):
    yield "a.gltf", {"a.gltf": gltf(None, address)}
    yield "a.gltf", {"a.gltf": gltf(address, "x.png")}
    yield "a.obj", {"a.obj": OBJ.format(address).encode()}
    material = f"newmtl m\nmap_Kd -s 1 1 1 {address}\nmap_d {address}\n"
    yield "a.obj", {"a.obj": OBJ.format("a.mtl").encode(), "a.mtl": material.encode()}
    yield "a.ply", {"a.ply": PLY.format(address).encode()}
    yield "a.dae", {"a.dae": DAE.replace("x.png", escape(address.replace("\0", "%00"))).encode()}


def read(main, given):
    try:
        return inputs.read(Bundle(main, main, given)).notes
    except InputError as error:
        return (str(error),)


picture = encode_png(np.zeros((2, 2, 3), np.uint8))
for main, given in files("own.png"):  # loads all modules
    read(main, given | {"own.png": picture})

seen = []
sys.addaudithook(lambda event, args: seen.append((event, args)) if event.split(".")[0] in WATCHED else None)
WATCHED = {"open", "os", "socket", "subprocess", "urllib", "ftplib", "http", "ctypes", "import", "shutil", "glob"}
count = 0
for address in ADDRESSES:
    for main, given in files(address):
        assert len(read(main, given)) > 0, (address, main)  # a note or an error on the missing file
        count += 1
WATCHED = set()
print(count, seen)
"""


def test_no_address_in_a_mesh_is_followed() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False, cwd=ROOT)  # noqa: S603
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{18 * 6} []\n"
