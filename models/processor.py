"""Checks whether this machine's processor supports int8 networks.

onnxruntime multiplies unsigned by signed bytes. Processors with a dot-product instruction for that (VNNI or AMX on x86,
the dot product of ARMv8.2) accumulate in 32 bits. Older x86 processors add pairs of products in 16 bits, which
saturates. Pictures then come out wrong, and no faster than in float (onnxruntime's page "Quantize ONNX models").
"""

from __future__ import annotations

import platform
from functools import cache
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")
X86 = frozenset({"avx_vnni", "avx512_vnni", "amx_int8"})
ARM = frozenset({"asimddp"})
"""Linux's names of the instructions. One of a set is enough."""


@cache
def int8_unsupported_reason() -> str:
    """Returns why this processor does not support int8 networks; empty if it does.

    Linux lists the instructions, and all of Apple's own processors have the dot product. On other systems int8 counts
    as unsupported.
    """
    system, machine = platform.system(), platform.machine().lower()
    if system == "Darwin" and machine == "arm64":
        return ""
    names = {"x86_64": X86, "amd64": X86, "aarch64": ARM, "arm64": ARM}.get(machine)
    if names is None:
        return f"int8 was not tried on {machine or 'this machine'}"
    try:
        text = CPUINFO.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return f"{system or 'this system'} doesn't list whether its processor has VNNI or a dot product"
    keys = ("flags", "Features")
    flags = {flag for line in text.splitlines() if line.startswith(keys) for flag in line.partition(":")[2].split()}
    if not flags:
        return f"{CPUINFO} doesn't list this processor's instructions"
    if flags & names:
        return ""
    return "this processor has no VNNI" if names is X86 else "this processor has no dot product (asimddp)"


def processor_name() -> str:
    """Returns the processor's name as the system reports it."""
    try:
        with CPUINFO.open(encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:  # not Linux
        pass
    return platform.processor() or platform.machine()
