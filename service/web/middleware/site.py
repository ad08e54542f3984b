"""Hosts and origins: keeps web pages from elsewhere from using a server that only their visitor can reach.

If a page makes its own name resolve to the server's address (DNS rebinding), the `Host` shows it. Other requests by
pages of other sites show in the headers that browsers add. Programs send neither `Sec-Fetch-Site` nor `Origin`.
"""

from __future__ import annotations

import ipaddress
from typing import TYPE_CHECKING

from fastapi import Request  # noqa: TC002 - FastAPI reads the annotations of dependencies
from starlette.exceptions import HTTPException

from ciir.service.settings import parse_host

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Sequence

SAFE_METHODS = ("GET", "HEAD", "OPTIONS")
"""Methods that change nothing."""
ANY = "*"


def is_loopback(name: str) -> bool:
    """Checks whether a host, given by name or address, is this machine."""
    try:
        return ipaddress.ip_address(name.partition("%")[0]).is_loopback
    except ValueError:
        return name == "localhost"


def require_own_site(hosts: Sequence[str], origins: Sequence[str]) -> Callable[[Request], Awaitable[None]]:
    """Makes a dependency that raises `HTTPException` 403 for another host, or another page's request to change things.

    `hosts`: accepted names besides those of loopback; if empty, or with `*`, all are accepted. `origins`: those of
    other pages that may send requests.
    """

    async def check(request: Request) -> None:
        host = request.headers.get("host", "")
        if hosts and ANY not in hosts and host and not _is_accepted(host, hosts):
            raise HTTPException(
                403,
                f"Host: {host[:80]!r} is not one of this server's; use {hosts[0]!r}, or list this name in CIIR_HOSTS",
            )
        origin, site = request.headers.get("origin"), request.headers.get("sec-fetch-site")
        if request.method in SAFE_METHODS or origin in origins or ANY in origins:
            return
        is_own = site in ("same-origin", "none") if site else origin is None or _find_authority(origin) == host.lower()
        if not is_own:
            given = repr(origin[:80]) if origin else f"without Origin, Sec-Fetch-Site: {(site or '')[:80]!r}"
            raise HTTPException(
                403,
                f"the request comes from a web page of another origin ({given}); "
                "use a page of this server, or list the origin in CIIR_CORS_ORIGINS",
            )

    return check


def _is_accepted(host: str, hosts: Sequence[str]) -> bool:
    try:
        name = parse_host(host)
    except ValueError:
        return False
    return is_loopback(name) or name in hosts


def _find_authority(origin: str) -> str:
    return origin.lower().partition("://")[2]
