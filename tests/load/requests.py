"""The requests of `tests.load.run` (small views, large arrays, meshes, bad files; some repeated), and their client."""

from __future__ import annotations

import http.client
import re
import time
from dataclasses import dataclass, field

import numpy as np

from ciir.renderer.scenes import modelling
from ciir.renderer.writers.pictures import encode_png
from tests.fuzz import seeds
from tests.fuzz.seeds import gltf

PATH = "/v1/reconstructions"
BOUNDARY = "--------------------------ciir-load"
ANSWER_SECONDS = 600
"""For each answer, and for all rounds of a request together."""
LATER = {409, 429, 503}
"""Statuses that come with `Retry-After` where the server wants to be asked again."""
ROUND = (
    *("small",) * 11,
    *("mesh",) * 4,
    *("array",) * 2,
    *("bad",) * 2,
    "again",
)
"""Kinds of twenty requests, before they are shuffled; one array in `ALL_VIEWS` is asked for in all its views."""
ALL_VIEWS = 5
AGAIN = 40
"""`again` is what was asked so many requests before, or a little earlier where that was `again` too."""


@dataclass(frozen=True)
class LoadRequest:
    """One request."""

    kind: str
    name: str
    """The file's name: its suffix says what it is."""
    data: bytes
    options: dict[str, str] = field(default_factory=dict)


def find_origin(number: int) -> tuple[str, int]:
    """The kind of request `number`, and the number of the one that it repeats: its own, but for `again`."""
    turn, place = divmod(number, len(ROUND))
    kind = str(np.random.default_rng(turn).permutation(ROUND)[place])
    if kind != "again":
        return kind, number
    return find_origin(number - AGAIN) if number >= AGAIN else ("small", number)


def make_request(number: int) -> LoadRequest:
    """Request `number`, the same each time."""
    kind, first = find_origin(number)
    return KINDS[kind](first)


def small(number: int) -> LoadRequest:
    """The centre view of 50x50 lenses, of a tetrahedron of its own."""
    corner = (number % 1009) / 1009, (number // 1009) / 1009
    rows = [*seeds.CORNERS[:3], (*corner, 1)]
    text = "OFF\n4 4 0\n" + "".join("{} {} {}\n".format(*row) for row in rows)
    text += "".join("3 {} {} {}\n".format(*face) for face in seeds.FACES)
    return LoadRequest("small", "small.off", text.encode(), {"lenses": "50x50"})


def mesh(number: int) -> LoadRequest:
    """Five views of a coloured mesh of some ten thousand triangles, as OBJ or as a zip with its material."""
    profile = np.stack([0.6 + 0.3 * np.sin(np.linspace(0, 3 + number % 7, 65)), np.linspace(-1, 1, 65)], axis=1)
    vertices, faces, _ = modelling.revolve(profile, 80)
    lines = ["mtllib a.mtl", "usemtl m", f"# {number}"]
    lines += ["v {:.6f} {:.6f} {:.6f}".format(*row) for row in vertices]
    lines += ["f {} {} {}".format(*row) for row in faces + 1]
    text = "\n".join(lines).encode()
    options = {"lenses": "60x60", "pixels": "9x9", "views": "cross"}
    if number % 2:
        return LoadRequest("mesh", "mesh.obj", text, options)
    material = b"newmtl m\nKd 0.9 0.4 0.2\n"
    return LoadRequest("mesh", "mesh.zip", seeds.zipped({"mesh.obj": text, "a.mtl": material}), options)


def array(number: int) -> LoadRequest:
    """Views of an array of 50x50 elemental images of 15x15 pixels: waves over the whole, and noise."""
    rng = np.random.default_rng(number)
    y, x = np.mgrid[0:750, 0:750].astype(np.float32) / 750
    waves = [np.sin(x * rng.uniform(5, 60) + y * rng.uniform(5, 60)) for _ in range(3)]
    picture = np.stack(waves, axis=2) * 100 + 128 + rng.normal(0, 2, (750, 750, 1))
    views = "all" if number % ALL_VIEWS == 0 else "cross"
    data = encode_png(np.clip(picture, 0, 255).astype(np.uint8))
    return LoadRequest("array", "array.png", data, {"lenses": "50x50", "views": views})


def bad(number: int) -> LoadRequest:
    """A file or an option that can't be taken."""
    tail = f"# {number}\n".encode()
    choices = [
        ("notes.txt", b"hello" + tail, {}),
        ("a.glb", gltf.glb()[0][: 40 + number % 100], {}),
        ("a.png", seeds.png()[2][:-20] + tail, {"lenses": "1x1"}),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 1 1\n2 2 2\n3 0 1 2\n" + tail, {}),
        ("a.off", seeds.off()[0] + tail, {"lenses": "0x5"}),
        ("a.off", seeds.off()[0] + tail, {"views": "99,0"}),
        ("a.off", seeds.off()[0] + tail, {"lenses": "9000x9000"}),
        ("a.zip", seeds.zipped({"../evil.obj": b"v 0 0 0\n" + tail}), {}),
        ("a.zip", seeds.zipped({"a.obj": bytes(2**24) + tail}), {}),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n" + tail, {}),
    ]
    return LoadRequest("bad", *choices[number // 3 % len(choices)])


KINDS = {"small": small, "mesh": mesh, "array": array, "bad": bad}


@dataclass(frozen=True)
class LoadAnswer:
    """What the server answered to a request in the end."""

    status: int
    ms: float
    """From the first byte sent to the last one received, of all rounds together."""
    pipeline_ms: float | None
    """The pipeline's own time, from the answer's `Server-Timing`."""
    statuses: tuple[int, ...]
    """Every status, in order."""


class Connection:
    """A connection to the server that is kept open, as a browser's is."""

    def __init__(self, port: int) -> None:
        self._http = http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_SECONDS)

    def ask(self, body: bytes) -> tuple[LoadAnswer, bytes]:
        """The answer to a form, and its body, after as many rounds as the server asks for.

        Raises `OSError` or `HTTPException` where there is none.
        """
        method, path = "POST", PATH
        headers = {"Content-Type": f"multipart/form-data; boundary={BOUNDARY}"}
        statuses: list[int] = []
        begun = time.perf_counter()
        while True:
            self._http.request(method, path, body if method == "POST" else None, headers if method == "POST" else {})
            answer = self._http.getresponse()
            content = answer.read()
            statuses.append(answer.status)
            if answer.status == 202:
                method, path = "GET", f"{answer.headers['Location']}/result"
            elif answer.status not in LATER or "Retry-After" not in answer.headers:
                break
            if time.perf_counter() - begun > ANSWER_SECONDS:
                break
            time.sleep(float(answer.headers.get("Retry-After", 1)))
        took = 1000 * (time.perf_counter() - begun)
        timing = re.search(r"\btotal;dur=([\d.]+)", answer.headers.get("Server-Timing", ""))
        return LoadAnswer(answer.status, took, float(timing[1]) if timing else None, tuple(statuses)), content

    def close(self) -> None:
        """Closes the connection."""
        self._http.close()


def make_form(given: LoadRequest) -> bytes:
    """The multipart body."""
    head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="'
    fields = "".join(f'{head}{name}"\r\n\r\n{value}\r\n' for name, value in given.options.items())
    file = f'{fields}{head}file"; filename="{given.name}"\r\nContent-Type: application/octet-stream\r\n\r\n'
    return file.encode() + given.data + f"\r\n--{BOUNDARY}--\r\n".encode()
