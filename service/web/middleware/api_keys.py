"""Optional API keys: one of them must come with a request, in one of two headers."""

from __future__ import annotations

import hmac
from hashlib import sha256
from typing import TYPE_CHECKING, Annotated

from fastapi import Security
from fastapi.security import APIKeyHeader, HTTPAuthorizationCredentials, HTTPBearer
from starlette.exceptions import HTTPException

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable, Iterable

_BEARER = HTTPBearer(auto_error=False, description="where the server has keys (CIIR_API_KEYS)")
_HEADER = APIKeyHeader(name="X-API-Key", auto_error=False, description="the same, in a header of its own")


def require_key(keys: Iterable[str]) -> Callable[..., Awaitable[None]]:
    """A dependency that raises `HTTPException` 401 unless one of `keys` was sent; with no keys it lets all pass.

    How long it takes says nothing of the keys: digests are compared, all of them, in constant time.
    """
    known = [sha256(key.encode()).digest() for key in keys]

    async def check(
        bearer: Annotated[HTTPAuthorizationCredentials | None, Security(_BEARER)],
        header: Annotated[str | None, Security(_HEADER)],
    ) -> None:
        given = [key for key in (header, bearer.credentials if bearer is not None else None) if key is not None]
        digests = [sha256(key.encode("latin-1")).digest() for key in given]  # as they came
        matches = [hmac.compare_digest(digest, key) for digest in digests for key in known]
        if known and not any(matches):
            fault = "the API key is not known" if given else "no API key was sent"
            raise HTTPException(
                401,
                f"{fault}; send one of the server's as 'Authorization: Bearer KEY' or 'X-API-Key: KEY'",
                {"WWW-Authenticate": 'Bearer realm="ciir"'},
            )

    return check
