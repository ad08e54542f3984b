"""`ciir serve`."""

from __future__ import annotations

import socket
from typing import TYPE_CHECKING

from renderer.errors import InvalidOption
from service.commands import common

if TYPE_CHECKING:
    import argparse

KEEP_ALIVE_SECONDS = 30


def run(args: argparse.Namespace) -> None:
    """Serves HTTP in one process until it is told to stop; requests that run are finished first."""
    if not (args.port.isdecimal() and int(args.port) <= 65535):
        raise InvalidOption(f"port: {args.port!r} is out of range; give 0 to 65535")
    import uvicorn

    from service import settings
    from service.app import create_app

    limits = settings.read()
    with _listening(args.host, int(args.port)) as listener:
        host, port = listener.getsockname()[:2]
        common.say(f"http://{f'[{host}]' if ':' in host else host}:{port}/docs tells what can be asked for")
        config = uvicorn.Config(create_app(limits), timeout_keep_alive=KEEP_ALIVE_SECONDS, server_header=False)
        server = uvicorn.Server(config)
        try:
            server.run([listener])
        except KeyboardInterrupt:  # uvicorn raises it anew after an orderly end
            return


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address, family=family, backlog=2048)
    except OSError as error:
        raise InvalidOption(f"{host}:{port}: {error.strerror}; name another --host or --port") from error
