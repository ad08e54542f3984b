"""The demo for the compose file: `python -m ciir.service.demo.over_http URL FOLDER`.

It makes a shipped scene's elemental image array, posts it to the service at URL, and writes the views to FOLDER. The
request sends the first key of `CIIR_API_KEYS` or `CIIR_API_KEYS_FILE`, if one is set.
"""

from __future__ import annotations

import io
import sys
import time
import zipfile
from pathlib import Path

from ciir.errors import ConnectionFailed, Error
from ciir.service.client import Client
from ciir.service.pipeline.elemental import encode_eia, render_eia
from ciir.service.pipeline.options import Options
from ciir.service.settings import read_settings

SCENE = "hamburger"
LENSES, PIXELS = "100x100", "5x5"
PATIENCE_SECONDS = 120
"""How long the service may take to start."""


def main(url: str, folder: Path) -> None:
    """Writes `eia.png`, `view_VV_UU.png` of five views and `report.json`. Raises `ciir.Error`."""
    folder.mkdir(parents=True, exist_ok=True)
    eia = folder / "eia.png"
    options = Options.parse({"lenses": LENSES, "pixels": PIXELS, "sampling": "lenslet"})
    render_eia(SCENE, options, lambda pixels: eia.write_bytes(encode_eia(pixels, options)))
    key = next((key.get_secret_value() for key in read_settings().api_keys), None)
    with Client(url, key, retries=PATIENCE_SECONDS) as client:
        _reach(client)
        made = client.reconstruct(eia, lenses=LENSES, views="cross", format="zip")
    with zipfile.ZipFile(io.BytesIO(made.content)) as archive:
        archive.extractall(folder)
        print(f"{folder}: eia.png, {', '.join(archive.namelist())} of the {SCENE}, by {url}", flush=True)


def _reach(client: Client) -> None:
    until = time.monotonic() + PATIENCE_SECONDS
    while True:
        try:
            client.get("/readyz")
        except ConnectionFailed:
            if time.monotonic() > until:
                raise
            time.sleep(0.25)
        else:
            return


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: python -m ciir.service.demo.over_http URL FOLDER")
    try:
        main(sys.argv[1], Path(sys.argv[2]))
    except Error as error:
        sys.exit(f"{sys.argv[1]}: {error}")
