"""Files that are made to cost much: how long they are read, and in how much memory.

    python -m tests.fuzz.costly [CASE ...] [--mebibytes 16]

Each case is made `--mebibytes` large, packed or not, and read in a process of its own under the address space that a
worker has by default. A line for each: size, seconds, memory, and what came of it. Exit status 1 where one takes longer
than `CIIR_JOB_SECONDS` is by default: what does is stopped by the server, but holds a worker for so long.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import struct
import sys
import time
import zlib
from typing import TYPE_CHECKING, Any, NamedTuple

from ciir.errors import InputError
from ciir.renderer.readers import inputs
from ciir.renderer.readers.bundle import Bundle
from ciir.renderer.readers.png import SIGNATURE
from ciir.renderer.writers.pictures.tiff import encode as encode_tiff
from ciir.service.settings import Settings
from tests.fuzz import gltf_seeds, seeds

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection

MIB = 2**20


class Costly(NamedTuple):
    """An upload."""

    name: str
    data: bytes


def comments(size: int) -> Costly:
    """An OFF behind comments."""
    return Costly("a.off", b"#\n" * (size // 2) + seeds.off()[0])


def long_face(size: int) -> Costly:
    """An OBJ of one face with corners without end."""
    return Costly("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + b"1 2 3 " * (size // 6))


def materials(size: int) -> Costly:
    """An OBJ that changes its material at every triangle."""
    uses = b"".join(b"usemtl %d\nf 1 2 3\n" % number for number in range(size // 22))
    return Costly("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + uses)


def _with_library(library: bytes, names: bytes = b"") -> Costly:
    text, _, picture = seeds.parts(seeds.obj()[0])
    return Costly("a.zip", seeds.zipped({"a.obj": names + text, "a.mtl": library, "x.png": picture}))


def map_options(size: int) -> Costly:
    """A texture's name behind options without end."""
    options = b" ".join(b"-bm %d" % (number * 7919 % 99991) for number in range(size // 9))
    return _with_library(b"newmtl m\nmap_Kd " + options + b" x.png\n")


def one_library_by_many_names(size: int) -> Costly:
    """A material file that an OBJ names 99 times."""
    library = b"".join(b"newmtl m%d\nKd %d\n" % (number, number) for number in range(size // 20))
    return _with_library(library, b"".join(b"mtllib %d/a.mtl\n" % number for number in range(99)))


def _gltf(primitives: list[dict[str, Any]], nodes: int, **mesh: object) -> Costly:
    document = gltf_seeds.document_of(None, {})
    document["materials"] = [{}]
    document["meshes"].append({"primitives": primitives, **mesh})
    document["nodes"] = [{"mesh": 2}] * nodes + [{"mesh": 1}]
    document["scenes"] = [{"nodes": list(range(nodes + 1))}]
    return Costly("a.glb", gltf_seeds.glb_of(document, gltf_seeds.stored()))


def nothing_again_and_again(size: int) -> Costly:
    """A mesh of points alone, in 10,000 nodes."""
    return _gltf([{"mode": 0}] * (size // 12), 10_000)


def weights_again_and_again(size: int) -> Costly:
    """A mesh with morph targets' weights, in 10,000 nodes."""
    return _gltf([], 10_000, weights=[0] * (size // 3))


def sparse_again_and_again(size: int) -> Costly:
    """An accessor of four elements that are replaced a million times, used by 1,000 primitives."""
    count = size // 13
    document = gltf_seeds.document_of(None, {})
    document["materials"] = [{}]
    start = len(gltf_seeds.stored())
    data = gltf_seeds.stored() + bytes(13 * count)
    views = document["bufferViews"]
    views += [{"buffer": 0, "byteOffset": start + at * count, "byteLength": n * count} for at, n in ((0, 1), (1, 12))]
    document["buffers"][0]["byteLength"] = len(data)
    indices, values = {"bufferView": 6, "componentType": 5121}, {"bufferView": 7}
    document["accessors"][4]["sparse"] = {"count": count, "indices": indices, "values": values}
    document["meshes"][1]["primitives"] *= 1000
    return Costly("a.glb", gltf_seeds.glb_of(document, data))


def lists(size: int) -> Costly:
    """A glTF whose JSON is empty lists."""
    return Costly("a.gltf", b'{"asset":{"version":"2.0"},"x":[' + b"[]," * (size // 3) + b"[]]}")


def rows(size: int) -> Costly:
    """A PLY of faces of one corner, and one of none: rows of different lengths."""
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 3\n"
    head += "".join(f"property float {name}\n" for name in "xyz")
    head += f"element face {size // 2}\nproperty list uchar uchar vertex_indices\nend_header\n"
    return Costly("a.ply", head.encode() + bytes(36) + b"\1\0" * (size // 2 - 1) + b"\0")


def elements(size: int) -> Costly:
    """A PLY whose header has no end."""
    head = b"ply\nformat binary_little_endian 1.0\n" + b"element a 0\nproperty char b\n" * (size // 28)
    return Costly("a.ply", head + b"end_header\n")


def pages(size: int) -> Costly:
    """A TIFF of one picture, and pages without any behind it."""
    data = bytearray(encode_tiff(seeds.noise(16, 16, 3)))
    data += bytes(len(data) % 2)
    first = struct.unpack_from("<I", data, 4)[0]
    count = struct.unpack_from("<H", data, first)[0]
    struct.pack_into("<I", data, first + 2 + 12 * count, len(data))
    starts = range(len(data), len(data) + size, 18)
    return Costly("a.tif", bytes(data) + b"".join(struct.pack("<HHHIII", 1, 254, 4, 1, 0, at + 18) for at in starts))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I4s", len(data), kind) + data + struct.pack(">I", zlib.crc32(kind + data))


def empty_chunks(size: int) -> Costly:
    """A PNG of pixel chunks without pixels."""
    good = seeds.png()[2]
    start = good.index(b"IDAT") - 4
    return Costly("a.png", good[:start] + _chunk(b"IDAT", b"") * (size // 12) + good[start:])


def black(size: int) -> Costly:
    """A PNG of 64 million pixels of 16-bit RGB and alpha, all black."""
    packed, row = zlib.compressobj(9), bytes(8000 * 8 + 1)
    pixels = b"".join(packed.compress(row) for _ in range(8000)) + packed.flush()
    header = struct.pack(">IIBBBBB", 8000, 8000, 16, 6, 0, 0, 0)
    chunks = _chunk(b"IHDR", header) + _chunk(b"IDAT", pixels) + _chunk(b"IEND", b"")
    return Costly("a.png", SIGNATURE + chunks)


def scans(size: int) -> Costly:
    """A progressive JPEG of 62 million pixels whose last scan comes again, 99 in all."""
    from PIL import Image

    data = seeds.saved(Image.new("RGB", (7900, 7900)), "JPEG", progressive=True)
    last = data[data.rindex(b"\xff\xda") : -2]
    return Costly("a.jpg", data[:-2] + last * (99 - data.count(b"\xff\xda")) + data[-2:])


def segments(size: int) -> Costly:
    """A JPEG of empty comments."""
    good = seeds.jpegs()[1]
    return Costly("a.jpg", good[:2] + b"\xff\xfe\0\2" * (size // 4) + good[2:])


def entries(size: int) -> Costly:
    """A zip of empty files."""
    return Costly("a.zip", seeds.zipped({f"{number}.png": b"" for number in range(min(size // 100, 65_000))}))


CASES: dict[str, Callable[[int], Costly]] = {
    case.__name__.replace("_", "-"): case
    for case in (
        comments, long_face, materials, map_options, one_library_by_many_names, nothing_again_and_again,
        weights_again_and_again, sparse_again_and_again, lists, rows, elements, pages, empty_chunks, black, scans,
        segments, entries,
    )
}  # fmt: skip


def read(case: str, size: int, out: Connection) -> None:
    """Makes and reads the case, and sends what it took. Runs in a process of its own."""
    memory = Settings().worker_memory_bytes
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    costly = CASES[case](size)
    begun = time.perf_counter()
    try:
        content = inputs.read(Bundle.from_upload(costly.name, costly.data), lenses=None, pixels=(1, 1))
        result = f"read: a {type(content).__name__}"
    except (InputError, MemoryError) as error:
        result = f"{type(error).__name__}: {error}"
    took = time.perf_counter() - begun
    out.send((len(costly.data), took, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024, result))


def main() -> int:
    """Prints a line for each case."""
    parser = argparse.ArgumentParser(prog="tests.fuzz.costly", description=main.__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"default: all of {', '.join(CASES)}")
    parser.add_argument("--mebibytes", type=int, default=16, help="size of each before a zip packs it (default 16)")
    given = parser.parse_args()
    context, most, holds = multiprocessing.get_context("spawn"), Settings().job_seconds, True
    for case in given.cases or CASES:
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=read, args=(case, given.mebibytes * MIB, sender))
        process.start()
        if receiver.poll(most + 60):  # making it takes time, too
            size, seconds, memory, result = receiver.recv()
            line = f"{size / MIB:5.1f} MiB {seconds:7.2f} s {memory / MIB:6.0f} MiB  {result[:100]}"
            holds = holds and seconds <= most
        else:
            line, holds = f"takes more than {most:.0f} s", False
        process.kill()
        process.join()
        print(f"{case:28s} {line}", flush=True)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
