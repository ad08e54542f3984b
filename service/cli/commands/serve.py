"""`ciir serve`: serves the HTTP API."""

from __future__ import annotations

import logging
import socket
from ipaddress import ip_address
from typing import TYPE_CHECKING

from ciir.errors import InvalidOption
from ciir.service.cli import common

if TYPE_CHECKING:
    import argparse

_log = logging.getLogger("ciir")


def run(args: argparse.Namespace) -> None:
    """Serves HTTP until SIGTERM or Ctrl-C, and runs jobs unless CIIR_WORKERS is 0."""
    if args.show_settings:
        from ciir.service.settings_table import format_values

        common.print_line(format_values())
        return
    if not (args.port.isdecimal() and int(args.port) <= 65535):
        raise InvalidOption(f"port: {args.port!r} is out of range; give 0 to 65535")
    from ciir.models import catalogue
    from ciir.service.web import connections
    from ciir.service.web.app import create_app
    from ciir.service.web.middleware.site import is_loopback
    from ciir.service.web.server import DrainingServer

    found = common.start_service()
    catalogue.list_entries()  # stops the command early if a folder in CIIR_MODELS can't be used
    connections.raise_file_limit()
    with _listening(args.host, int(args.port)) as listener:
        # Connections inherit this option. Without it the body waits 40 ms for its header; asyncio sets it only on its
        # own sockets.
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        host, port = listener.getsockname()[:2]
        if is_open(host, len(found.api_keys)):
            _log.warning("%s is not a loopback address and CIIR_API_KEYS is not set: everybody can use the API", host)
        if is_loopback(host) and not found.hosts:
            found = found.model_copy(update={"hosts": ("localhost",)})
        app = create_app(found)
        _log.info(app.state.service.engine.describe_place())
        message = f"{find_url(host, port)} is the web page; /docs describes the API"
        if found.log_format == "json":
            _log.info(message)
        else:
            common.print_line(message)
        DrainingServer(app).run([listener])


def is_open(host: str, keys: int) -> bool:
    """Checks whether other machines can use the service at an IP address without one of this many keys."""
    from ciir.service.web.middleware.site import is_loopback

    return not keys and not is_loopback(host)


def find_url(host: str, port: int) -> str:
    """Returns an address that a browser on this machine can open: localhost if the server listens on all addresses."""
    if ip_address(host.partition("%")[0]).is_unspecified:
        host = "localhost"
    return f"http://{f'[{host}]' if ':' in host else host}:{port}"


def _listening(host: str, port: int) -> socket.socket:
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return socket.create_server(address, family=family)
    except OSError as error:
        raise InvalidOption(f"{host}:{port}: {error.strerror}; name another --host or --port") from error
