"""Restricts the files that a worker process can open, by Landlock, to libraries, networks, fonts and drivers.

They can only be read. Files of jobs can't be opened: a job's input and result come as open files
(`service.jobs.workers.worker`). See landlock(7) of Linux.
"""

from __future__ import annotations

import ctypes
import os
import platform
import site
import stat
import struct
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

_CREATE, _ADD, _RESTRICT = 444, 445, 446  # system calls, the same on x86_64 and aarch64
_VERSION = 1
"""Flag: return the version."""
_RULE_PATH_BENEATH = 1
_WRITE, _READ, _LIST, _TRUNCATE, _IOCTL = 2, 4, 8, 1 << 14, 1 << 15
_RIGHTS = ((1, 0x1FFF), (2, 1 << 13), (3, _TRUNCATE), (5, _IOCTL))
"""Rights to files, and the version that introduced them."""
_NETWORK = (4, 0b11)  # bind and connect TCP
_SCOPES = (6, 0b11)  # abstract sockets, signals
_LATEST_NEEDED = 6

READ = (
    "/usr", "/lib", "/lib64", "/nix/store",
    "/etc/ld.so.cache", "/etc/localtime", "/etc/glvnd", "/etc/drirc", "/etc/fonts",
    "/etc/ssl/openssl.cnf", "/etc/pki/tls/openssl.cnf", "/etc/crypto-policies",
    "/proc/cpuinfo", "/proc/meminfo", "/proc/stat", "/proc/self", "/proc/sys/vm",
    "/sys/devices", "/sys/bus", "/sys/class/drm", "/sys/dev/char",
    "/dev/urandom", "/dev/random", "/dev/zero", "/run/opengl-driver",
)  # fmt: skip
"""Files and folders of the system that can be read."""
DEVICES = ("/dev/null", "/dev/dri", "/dev/nvidiactl", "/dev/nvidia0", "/dev/nvidia-modeset", "/dev/nvidia-uvm")
"""Devices, including graphics, that can be read, written and controlled."""

_kept: list[int] = []
"""Open folders to which rules apply: a folder of /proc that nobody has open can get another identity, without rules."""


def restrict(readable: Sequence[str]) -> list[str]:
    """Restricts this thread and those that it starts. Returns what could not be restricted.

    `readable`: more files that can be read. Raises `PermissionError` if those of Python or this package can't be read.
    """
    package = Path(__file__).parents[4]
    for path in (sys.prefix, sys.base_prefix, str(package)):
        if not os.access(path, os.R_OK | os.X_OK):
            remedy = "install it where its user may read, or run it as the owner"
            raise PermissionError(f"{path}: worker processes have no capabilities and can't read it; {remedy}")
    if platform.machine() not in ("x86_64", "aarch64"):
        return [f"it can open all files of its user: Landlock was not tried on {platform.machine()}"]
    try:
        version = _call(_CREATE, None, 0, _VERSION)
        _enter(version, _list_readable(package, readable))
    except OSError as error:
        return [f"it can open all files of its user: the kernel has no Landlock ({error.strerror})"]
    if version < _LATEST_NEEDED:
        return [f"the kernel's Landlock has version {version}; signals and abstract sockets need {_LATEST_NEEDED}"]
    return []


def find_exposed(private: Mapping[str, Path]) -> list[str]:
    """Returns a sentence on each of `private`, paths by name, that is exposed because it lies among libraries."""
    package = Path(__file__).parents[4]
    granted = [Path(path).resolve() for path in _list_readable(package, ())]
    sentences = []
    for name, path in private.items():
        above = next((folder for folder in granted if path.resolve().is_relative_to(folder)), None)
        if above is not None:
            sentences.append(f"it can read {name} ({path}), which lies beneath {above}; move it out of there")
    return sentences


def _enter(version: int, readable: Sequence[str]) -> None:
    handled = sum(rights for since, rights in _RIGHTS if version >= since)
    network, scopes = (rights if version >= since else 0 for since, rights in (_NETWORK, _SCOPES))
    attributes = struct.pack("=QQQ", handled, network, scopes)
    rules = _call(_CREATE, attributes, len(attributes), 0)
    for path in readable:
        _allow(rules, path, (_READ | _LIST) & handled)
    for path in DEVICES:
        _allow(rules, path, (_READ | _WRITE | _LIST | _IOCTL) & handled)
    _call(_RESTRICT, rules, 0)
    os.close(rules)


def _list_readable(package: Path, more: Sequence[str]) -> list[str]:
    """Files and folders to read: of the system, of Python, of installed packages, of this package, and `more`."""
    modules = [str(path.resolve()) for path in package.iterdir()]  # in the repository they are links
    installed = [sys.prefix, sys.base_prefix, *site.getsitepackages(), site.getusersitepackages()]
    libraries = [
        path
        for path in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep)
        if Path(path).is_absolute() and os.path.realpath(path) != "/"  # others would be looked up in /, the cwd
    ]
    return list(dict.fromkeys([*READ, *installed, str(package), *modules, *libraries, *more]))


def _allow(rules: int, path: str, rights: int) -> None:
    """Adds a rule, unless the path does not exist for this user."""
    try:
        opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return
    _kept.append(opened)
    if not stat.S_ISDIR(os.fstat(opened).st_mode):
        rights &= ~_LIST
    _call(_ADD, rules, _RULE_PATH_BENEATH, struct.pack("=Qi", rights, opened), 0)


def _call(number: int, *arguments: object) -> int:
    """Makes a system call. Raises `OSError`."""
    wide = (ctypes.c_long(argument) if isinstance(argument, int) else argument for argument in arguments)
    result = int(ctypes.CDLL(None, use_errno=True).syscall(ctypes.c_long(number), *wide))
    if result < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return result
