"""Settings of the service, read from environment variables `CIIR_...`.

docs/settings.md is made from their docstrings.
"""

from __future__ import annotations

import logging
import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import AfterValidator, BeforeValidator, Field, SecretStr, ValidationError
from pydantic_settings import BaseSettings, NoDecode, SettingsConfigDict

from ciir.errors import InvalidOption
from ciir.model_folder import MODEL_FOLDER
from ciir.renderer.limits import DEFAULT_LIMITS, Limits
from ciir.service.pipeline.limits import SETTINGS

PREFIX = "CIIR_"
_MOST = 2**40
_log = logging.getLogger("ciir")


def _number(default: float, least: float, most: float) -> Any:
    return Field(default=default, ge=least, le=most, allow_inf_nan=False)


def _limit(field: str) -> Any:
    _, least, most = SETTINGS[field]
    return _number(getattr(DEFAULT_LIMITS, field), least, most)


def _split_list(given: object) -> object:
    """Splits the text at commas or line ends, without repeated items and outer spaces."""
    if isinstance(given, str):
        found = tuple(dict.fromkeys(part.strip() for part in re.split(r"[,\r\n]", given) if part.strip()))
        if not found:  # an empty list of keys would open the server to everybody
            raise ValueError("the list is empty")
        return found
    return given


def _check_queue(given: str) -> str:
    if given and re.match(r"(rediss?|unix)://.", given) is None:
        raise ValueError("not the address of a Redis server, such as redis://localhost:6379/0")
    return given


def _check_files(given: str) -> str:
    """Returns an address as it is, or a folder's absolute path; empty for the default."""
    if given.startswith("memory://"):
        raise ValueError("files in the memory of this process, which no restart and no other process can read")
    if re.match(r"[A-Za-z0-9+]+:(?!//)", given):  # this is a valid folder name, but s3:BUCKET is meant as an address
        raise ValueError("an address without //")
    if not given or "://" in given:
        return given
    return str(Path(os.path.expanduser(given)).absolute())  # noqa: PTH111 - Path's raises for an unknown user


def parse_host(host: str) -> str:
    """Returns the name or address in a `Host`, in lower case, without port and brackets. Raises `ValueError`."""
    parts = urlsplit(f"//{host}")
    if parts.netloc != host or "@" in host or not parts.hostname:
        raise ValueError("no host")
    return parts.hostname


def _parse_hosts(given: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the hosts as `parse_host` does. An IPv6 address can be given without brackets."""
    if any("*" in host and host != "*" for host in given):
        raise ValueError("an asterisk can't stand for a part of a name")
    return tuple(parse_host(f"[{host}]" if host.count(":") > 1 and host[0] != "[" else host) for host in given)


def _parse_origins(given: tuple[str, ...]) -> tuple[str, ...]:
    """Returns the origins as browsers send them: in lower case, without the scheme's usual port.

    `*` is any, `null` none.
    """
    return tuple(origin if origin in ("*", "null") else _parse_origin(origin.lower()) for origin in given)


def _parse_origin(origin: str) -> str:
    scheme, _, host = origin.partition("://")
    parse_host(host)
    if not scheme or "*" in host or not origin.isascii():
        raise ValueError("no origin")
    is_usual = urlsplit(origin).port == {"http": 80, "https": 443}.get(scheme, -1)  # raises if the port is not a number
    return origin.rpartition(":")[0] if is_usual else origin


class Settings(BaseSettings):
    """The settings. An empty variable counts as not set. pydantic's `ValidationError` is raised for a bad value."""

    model_config = SettingsConfigDict(
        env_prefix=PREFIX, env_ignore_empty=True, use_attribute_docstrings=True, frozen=True, hide_input_in_errors=True
    )

    # Places

    folder: Path | None = None
    """Folder for jobs, inputs and results; default: `ciir/service` in `XDG_CACHE_HOME`, else in `~/.cache`."""
    queue: Annotated[str, AfterValidator(_check_queue)] = ""
    """Address of the Redis server that holds the queue, redis://HOST:PORT/NUMBER; several machines can share it.
    Default: a SQLite file in `CIIR_FOLDER`."""
    queue_file: Path | None = None
    """File that holds `CIIR_QUEUE`, for an address with a password. Lines that begin with # are comments."""
    files: Annotated[str, AfterValidator(_check_files)] = ""
    """Folder for inputs and results, or s3://BUCKET/PATH (extra `[s3]`; the image has it); default: `files` in
    `CIIR_FOLDER`. Machines that share a queue must share this too."""

    # Parallel work and time limits

    workers: int = _number(2, 0, 64)
    """Worker processes on this machine; each runs one job at a time. With 0 this server runs none, and
    `ciir worker` does the jobs."""
    max_waiting: int = _number(256, 1, 1_000_000)
    """Maximum number of waiting jobs in each of the two lanes, for small and for large jobs; further requests are
    answered with 429 and `Retry-After`."""
    sync_seconds: float = _number(10.0, 0.0, 3600.0)
    """Seconds that a request waits for its result; after that it is answered with 202 and the job's address."""
    max_connections: int = _number(2000, 1, 1_000_000)
    """Maximum number of open connections, or fewer if the limit on open files is low. The connection that has been idle
    for longest ends for a new one; while none is idle, new ones are answered with 503."""
    max_streams: int = _number(1000, 1, 1_000_000)
    """Maximum number of open event streams; further ones are answered with 429."""
    max_client_streams: int = _number(100, 1, 1_000_000)
    """Maximum number of open event streams of one client, which is an API key, or an address if there are no keys."""
    drain_seconds: float = _number(20.0, 0.0, 3600.0)
    """Seconds that running jobs have to finish after SIGTERM; jobs that have not finished go back into the queue."""
    client_seconds: float = _number(30.0, 0.1, 3600.0)
    """Seconds that a client has to send the head of a request, and for which it may read nothing of a response, before
    its connection is closed."""
    body_seconds: float = _number(120.0, 0.1, 3600.0)
    """Seconds within which the whole body of a request must arrive."""

    # Results that are kept

    keep_seconds: int = _number(86_400, 1, 10**9)
    """Seconds that a finished job and its result, or a file for several requests, are kept after the last request for
    them. At most 50,000 finished jobs and files are kept."""
    keep_bytes: int = _number(2 * 2**30, 0, _MOST)
    """Maximum bytes of all kept results, files, and records of jobs together. Those that were requested longest ago are
    removed first, but none within a minute of its last request."""

    # Limits on input and output

    max_body_bytes: int = _number(64 * 2**20, 1024, _MOST)
    """Maximum bytes of a request's body, with or without a declared length."""
    max_files: int = _limit("files")
    """Maximum number of files in a zip."""
    max_unpacked_bytes: int = _limit("bytes")
    """Maximum unpacked bytes of all files of a zip together."""
    max_ratio: int = _limit("ratio")
    """Maximum ratio of unpacked to packed bytes of a zip; checked from 1 MiB unpacked."""
    max_pixels: int = _limit("pixels")
    """Maximum pixels of a picture, checked before decoding, and of all textures of a mesh. A texture is scaled down to
    half of the pixels that are left."""
    max_set_bytes: int = _limit("set_bytes")
    """Maximum decoded bytes of all pictures in a set of views together."""
    max_triangles: int = _limit("triangles")
    """Maximum triangles of a mesh; it can have three times as many vertices."""
    max_views: int = _limit("views")
    """Maximum number of views in a result, and in a set of views that is sent."""
    max_output_pixels: int = _number(256_000_000, 1, _MOST)
    """Maximum pixels of all views of a result together, and maximum samples of a mesh for them."""

    # Limits on a worker process

    job_seconds: float = _number(300.0, 0.1, 86_400.0)
    """Seconds after which a running job is stopped."""
    worker_cpu_seconds: int = _number(3600, 1, 864_000)
    """Maximum processor seconds of one job, summed over all cores."""
    worker_memory_bytes: int = _number(4 * 2**30, 2**30, _MOST)
    """Maximum bytes of address space of a worker process (RLIMIT_AS). Libraries and thread stacks count too, so that
    machines with very many cores need more."""
    worker_file_bytes: int = _number(2 * 2**30, 2**20, _MOST)
    """Maximum bytes of a file that a worker process writes, and therefore of a result (RLIMIT_FSIZE)."""
    worker_jobs: int = _number(1000, 1, 1_000_000)
    """Number of jobs after which a worker process is replaced by a new one."""

    # Access, logs and metrics

    api_keys: Annotated[tuple[SecretStr, ...], NoDecode, BeforeValidator(_split_list)] = ()
    """API keys, separated by commas or line ends. A request must send one of them as `Authorization: Bearer KEY` or
    `X-API-Key`. Default: no key is needed."""
    api_keys_file: Path | None = None
    """File that holds `CIIR_API_KEYS`, as Docker and Kubernetes mount secrets. Lines that begin with # are comments."""
    hosts: Annotated[tuple[str, ...], NoDecode, BeforeValidator(_split_list), AfterValidator(_parse_hosts)] = ()
    """Names or addresses, in addition to those of this machine (localhost, 127.0.0.0/8, [::1]), that the `Host` of a
    request may have, with any port, separated by commas; `*`: any. Default: none if the server listens on loopback,
    else any."""
    cors_origins: Annotated[
        tuple[str, ...], NoDecode, BeforeValidator(_split_list), AfterValidator(_parse_origins)
    ] = ()
    """Origins of other web pages whose scripts may use the API, such as https://example.org or http://localhost:3000,
    without a path, separated by commas; `*`: any. Default: none."""
    log_format: Literal["text", "json"] = "text"
    """Format of log lines: `text`, or `json` with one object per line."""
    metrics_port: int = _number(0, 0, 65535)
    """Port on which `ciir worker` serves its metrics, on all addresses; 0: none. The web process serves its own at
    /metrics."""

    def find_folder(self) -> Path:
        """Returns the absolute path of the folder for jobs: `folder`, else one in the user's folder for caches.

        Raises `InvalidOption` if neither is known.
        """
        if self.folder is not None:
            return self.folder.absolute()
        if cache := os.environ.get("XDG_CACHE_HOME"):
            return Path(cache).absolute() / "ciir" / "service"
        try:
            return Path.home() / ".cache" / "ciir" / "service"
        except RuntimeError as error:
            raise InvalidOption(f"{PREFIX}FOLDER: not set, and this user has no home folder; name a folder") from error

    @property
    def limits(self) -> Limits:
        """Limits on an input."""
        return Limits(
            files=self.max_files,
            bytes=self.max_unpacked_bytes,
            ratio=self.max_ratio,
            pixels=self.max_pixels,
            set_bytes=self.max_set_bytes,
            triangles=self.max_triangles,
            views=self.max_views,
        )


def warn_of_unknown() -> None:
    """Logs a warning for each variable that begins with `CIIR_` but is not a setting."""
    known = {f"{PREFIX}{name.upper()}" for name in Settings.model_fields} | {MODEL_FOLDER}
    for name in sorted(name for name in os.environ if name.startswith(PREFIX) and name not in known):
        _log.warning("%s is set, but is not a setting; `ciir serve --show-settings` lists all", name)


def read_settings() -> Settings:
    """Reads the settings from the environment. Raises `InvalidOption`."""
    secrets: dict[str, Any] = {}
    try:
        found = Settings()
        for name, path in (("api_keys", found.api_keys_file), ("queue", found.queue_file)):
            if path is not None:
                secrets[name] = _read_secret(f"{PREFIX}{name.upper()}", path)
        return Settings(**secrets)
    except ValidationError as error:
        name = str(error.errors()[0]["loc"][0])
        given = secrets.get(name, os.environ.get(f"{PREFIX}{name.upper()}", ""))
        default = Settings.model_fields[name].default
        more = f" for the default {default}" if default not in ((), "", None) else ""
        raise InvalidOption(
            f"{PREFIX}{name.upper()}: {hide_secrets(given)[:80]!r} is not {describe_values(name)}; "
            f"set one, or unset it{more}"
        ) from error


def _read_secret(variable: str, path: Path) -> str:
    """Reads the file `path`, which is given instead of `variable`, without its comments. Raises `InvalidOption`."""
    if os.environ.get(variable):
        raise InvalidOption(f"{variable} and {variable}_FILE are both set; unset one")
    try:
        content = path.read_text(encoding="utf-8-sig")  # editors on Windows begin a file with a byte order mark
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8"
        raise InvalidOption(f"{variable}_FILE: {path}: {reason}; name a file that can be read") from error
    content = re.sub(r"^\s*#.*", "", content, flags=re.MULTILINE).strip()
    if not content:
        raise InvalidOption(f"{variable}_FILE: {path} is empty; write {variable} into it, or unset {variable}_FILE")
    return content


def hide_secrets(address: str) -> str:
    """Returns `address` without user name, password and query."""
    return re.sub(r"(://.*\?).*", r"\1...", re.sub(r"//[^/]*@", "//...@", address))


def describe_values(name: str) -> str:
    """Describes the values that the setting `name` can have, such as `a whole number from 0 to 64`."""
    schema = Settings.model_json_schema()["properties"][name]
    if "enum" in schema:
        return " or ".join(schema["enum"])
    if "maximum" in schema:
        kind, form = ("whole number", "") if schema["type"] == "integer" else ("number", "g")
        return f"a {kind} from {schema['minimum']:{form}} to {schema['maximum']:{form}}"
    return _VALUES[name]


_VALUES = {
    "folder": "a folder's path",
    "queue": "empty, or the address of a Redis server such as redis://localhost:6379/0",
    "queue_file": "a file's path",
    "api_keys_file": "a file's path",
    "files": "a folder's path, or an address such as s3://BUCKET/PATH",
    "api_keys": "keys separated by commas or line ends",
    "hosts": "`*`, or whole names or addresses separated by commas",
    "cors_origins": "`*`, or origins separated by commas, each a scheme and a host such as https://example.org",
}
