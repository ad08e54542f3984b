"""What the service can be told by environment variables, `CIIR_...`: places, limits, how much at once.

A setting's docstring is its documentation: `ciir serve --show-settings` prints it, and docs/settings.md is made from it
(`service.settings_table`).
"""

from __future__ import annotations

import logging
import os
import re
from pathlib import Path  # noqa: TC003 - pydantic evaluates the annotations
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import AfterValidator, BeforeValidator, Field, SecretStr, ValidationError
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from ciir.errors import InvalidOption
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.service.pipeline import cache_folder

PREFIX = "CIIR_"
_MOST = 2**40
_log = logging.getLogger("ciir")


def _number(default: float, least: float, most: float) -> Any:
    return Field(default=default, ge=least, le=most, allow_inf_nan=False)


def _listed(given: object) -> object:
    """What is between commas, each once, without the spaces around it."""
    if isinstance(given, str):
        found = tuple(dict.fromkeys(part.strip() for part in given.split(",") if part.strip()))
        if not found:  # who sets keys and gets them wrong would have a server that is open to all
            raise ValueError("nothing is between the commas")
        return found
    return given


def _queue(given: str) -> str:
    if given and re.match(r"(rediss?|unix)://.", given) is None:
        raise ValueError("no address of a Redis server, such as redis://localhost:6379/0")
    return given


class Settings(BaseSettings):
    """Read from `CIIR_...`; raises pydantic's `ValidationError` where one is out of range. Empty counts as not set."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, env_ignore_empty=True, use_attribute_docstrings=True, frozen=True, hide_input_in_errors=True
    )

    # Places

    folder: Path | None = None
    """The folder of the server's jobs, inputs and results; `service` in the cache folder where none is named."""
    queue: Annotated[str, AfterValidator(_queue)] = ""
    """The Redis server that holds the jobs, redis://HOST:PORT/NUMBER, where several machines share them; a file in the
    folder where none is named."""
    files: str = ""
    """Where inputs and results are kept: a folder, or s3://BUCKET/PATH (needs s3fs); `files` in the folder where none
    is named. Machines that share a queue share this, too."""

    # How much at once

    workers: int = _number(2, 0, 64)
    """Worker processes on this machine, each of which does one reconstruction at a time; 0: the web process alone,
    with `ciir worker` elsewhere."""
    max_waiting: int = _number(256, 1, 1_000_000)
    """Most jobs that wait in each of the two queues, for small and for large ones; a request beyond that is answered
    with 429 and told when to come again."""
    sync_seconds: float = _number(10.0, 0.0, 3600.0)
    """Seconds that a request waits for its result before it is answered with 202 and the job's address."""
    drain_seconds: float = _number(20.0, 0.0, 3600.0)
    """Seconds after SIGTERM in which what runs may finish; what doesn't is put back into the queue."""
    client_seconds: float = _number(30.0, 0.1, 3600.0)
    """Seconds in which a client has to send a request's head, and to take each next part of an answer, before its
    connection is closed."""
    body_seconds: float = _number(120.0, 0.1, 3600.0)
    """Seconds in which a request's whole body has to arrive."""

    # How long, and how many, results are kept

    keep_seconds: int = _number(86_400, 1, 10**9)
    """Seconds for which a finished job and its result are kept, after it was last asked for; 50,000 at most."""
    keep_bytes: int = _number(2 * 2**30, 0, _MOST)
    """Most bytes of all results that are kept. The longest unused are removed first, but none within a minute of its
    last request, so that every client gets its result."""

    # What may be sent

    max_body_bytes: int = _number(64 * 2**20, 1024, _MOST)
    """Most bytes in a request's body, declared or chunked."""
    max_files: int = _number(DEFAULT_LIMITS.files, 1, 1_000_000)
    """Most files in a zip."""
    max_unpacked_bytes: int = _number(DEFAULT_LIMITS.bytes, 1024, _MOST)
    """Most bytes of all files of a zip together, unpacked."""
    max_ratio: int = _number(DEFAULT_LIMITS.ratio, 1, 100_000)
    """Most unpacked bytes for each packed byte of a zip, looked at from 1 MiB unpacked up."""
    max_pixels: int = _number(DEFAULT_LIMITS.pixels, 1, _MOST)
    """Most pixels in a picture, and in all textures of a mesh together; looked at before any is decoded."""
    max_set_bytes: int = _number(DEFAULT_LIMITS.set_bytes, 1, _MOST)
    """Most bytes of all pictures of a set of views together, decoded."""
    max_triangles: int = _number(DEFAULT_LIMITS.triangles, 1, 100_000_000)
    """Most triangles in a mesh, which may have three times as many vertices."""
    max_views: int = _number(DEFAULT_LIMITS.views, 1, 16_777_216)
    """Most views in one answer, and in a set of them."""
    max_output_pixels: int = _number(256_000_000, 1, _MOST)
    """Most pixels, and samples of a mesh, in all views of one answer."""

    # What a worker process may use

    job_seconds: float = _number(300.0, 0.1, 86_400.0)
    """Seconds after which a reconstruction that still runs is stopped."""
    worker_cpu_seconds: int = _number(3600, 1, 864_000)
    """Most seconds of processor time, of all cores together, that one reconstruction may take."""
    worker_memory_bytes: int = _number(4 * 2**30, 2**30, _MOST)
    """Most bytes of address space of a worker process (RLIMIT_AS). Programs and what threads set aside count,
    too: machines of very many cores need more."""
    worker_file_bytes: int = _number(2 * 2**30, 2**20, _MOST)
    """Most bytes in a file that a worker process writes, so in a result (RLIMIT_FSIZE)."""
    worker_jobs: int = _number(1000, 1, 1_000_000)
    """Reconstructions after which a worker process is replaced by a new one."""

    # Who may ask, and what is told

    api_keys: Annotated[tuple[SecretStr, ...], NoDecode, BeforeValidator(_listed)] = ()
    """Keys, with commas between them, one of which a request must bring as `Authorization: Bearer KEY` or `X-API-Key`;
    none: anyone may ask."""
    cors_origins: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_listed)] = ()
    """Web pages' origins, such as https://example.org, with commas between them, whose scripts may ask; none: no
    other's."""
    log_format: Literal["text", "json"] = "text"
    """`text`, or `json` for one object a line."""
    metrics_port: int = _number(0, 0, 65535)
    """Port on which `ciir worker` shows its metrics, on all addresses; 0: it doesn't. The web process has them at
    /metrics."""

    def find_folder(self) -> Path:
        """The folder of the server's jobs. Raises `InvalidOption` where none is named and no cache folder is known."""
        if self.folder is not None:
            return self.folder
        kept = cache_folder.folder()
        if kept is None:
            raise InvalidOption(f"{PREFIX}FOLDER: this user has no home to keep jobs in; name a folder")
        return kept / "service"

    @property
    def limits(self) -> Limits:
        """What an input may hold, as `renderer` wants to be told."""
        return Limits(
            files=self.max_files,
            bytes=self.max_unpacked_bytes,
            ratio=self.max_ratio,
            pixels=self.max_pixels,
            set_bytes=self.max_set_bytes,
            triangles=self.max_triangles,
            views=self.max_views,
        )


def read_settings() -> Settings:
    """The settings of the environment; `InvalidOption` in place of what pydantic says.

    Names that begin as settings do and are none, most likely misspelt, are told in the log.
    """
    known = {f"{PREFIX}{name.upper()}" for name in Settings.model_fields} | {cache_folder.NAME}
    for name in sorted(name for name in os.environ if name.startswith(PREFIX) and name not in known):
        _log.warning("%s is set, and there is no such setting; `ciir serve --show-settings` lists them", name)
    try:
        return Settings()
    except ValidationError as error:
        name = str(error.errors()[0]["loc"][0])
        given = os.environ.get(f"{PREFIX}{name.upper()}", "")
        raise InvalidOption(
            f"{PREFIX}{name.upper()}: {hide_secrets(given)[:80]!r} is not {describe_values(name)}; "
            f"set that, or unset it for the default of {Settings.model_fields[name].default!r}"
        ) from error


def unset_secrets() -> None:
    """Takes the API keys and the queue's password out of this process's environment: processes that it starts from now
    on, which read what strangers send, don't have them.
    """
    for name in ("API_KEYS", "QUEUE"):
        os.environ.pop(f"{PREFIX}{name}", None)


def hide_secrets(address: str) -> str:
    """`address` to be shown: without a user's name, a password, or what stands behind a question mark."""
    return re.sub(r"(://.*\?).*", r"\1...", re.sub(r"//[^/]*@", "//...@", address))


def describe_values(name: str) -> str:
    """What the setting `name` may be, in words: `a whole number from 0 to 64`."""
    field = Settings.model_fields[name]
    if get_origin(field.annotation) is Literal:
        return " or ".join(get_args(field.annotation))
    if field.annotation in (int, float):
        least, most = (
            next(getattr(rule, key) for rule in field.metadata if hasattr(rule, key)) for key in ("ge", "le")
        )
        form = "" if field.annotation is int else "g"
        return f"a {'whole ' if field.annotation is int else ''}number from {least:{form}} to {most:{form}}"
    return _WORDS[name]


_WORDS = {
    "folder": "a folder's path",
    "queue": "empty, or the address of a Redis server such as redis://localhost:6379/0",
    "files": "a folder's path, or an address such as s3://BUCKET/PATH",
    "api_keys": "keys with commas between them",
    "cors_origins": "origins with commas between them",
}
