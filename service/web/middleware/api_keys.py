"""API keys: a request must send one of the server's, if it has any."""

from __future__ import annotations

import hmac
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated

from fastapi import Request, Security
from fastapi.security import APIKeyHeader, HTTPAuthorizationCredentials, HTTPBearer
from starlette.exceptions import HTTPException

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable

_BEARER = HTTPBearer(auto_error=False, description="needed if the server has keys (CIIR_API_KEYS)")
_HEADER = APIKeyHeader(name="X-API-Key", auto_error=False, description="the same key in a separate header")


def require_key(keys: Iterable[str]) -> Callable[..., Awaitable[None]]:
    """Makes a dependency that raises `HTTPException` 401 unless a request sends one of `keys`.

    Without keys it accepts all requests. Digests of all keys are compared in constant time, so that the duration does
    not depend on the keys.
    """
    digests = [sha256(key.encode()).digest() for key in keys]

    async def check(
        request: Request,
        bearer: Annotated[HTTPAuthorizationCredentials | None, Security(_BEARER)],
        header: Annotated[str | None, Security(_HEADER)],
    ) -> None:
        sent = [key for key in (header, bearer.credentials if bearer is not None else None) if key is not None]
        sent_digests = [sha256(key.encode("latin-1")).digest() for key in sent]  # the bytes as they were sent
        matches = [digest for one in sent_digests for digest in digests if hmac.compare_digest(one, digest)]
        if matches:
            request.state.client = matches[0].hex()
        elif digests:
            cause = "the API key is not known" if sent else "no API key was sent"
            raise HTTPException(
                401,
                f"{cause}; send one of the server's as 'Authorization: Bearer KEY' or 'X-API-Key: KEY'",
                {"WWW-Authenticate": 'Bearer realm="ciir"'},
            )

    return check


def hash_client(request: Request) -> str:
    """Returns a short digest of `find_client`, for storing."""
    return sha256(find_client(request).encode()).hexdigest()[:16]


def find_client(request: Request) -> str:
    """Identifies the client that sent a request: by the digest of its API key, else by its address."""
    address = request.client.host if request.client is not None else ""
    return getattr(request.state, "client", address)
