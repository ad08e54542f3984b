"""What this machine's processor can do for int8 networks.

onnxruntime multiplies unsigned by signed bytes. Processors with a dot-product instruction for that (VNNI or AMX on x86,
the dot product of ARMv8.2) add up in 32 bits. Older x86 ones add pairs of products in 16 bits, which saturates: the
picture comes out wrong, and no quicker than in float (onnxruntime's page "Quantize ONNX models").
"""

from __future__ import annotations

import platform
from functools import cache
from pathlib import Path

CPUINFO = Path("/proc/cpuinfo")
X86 = frozenset({"avx_vnni", "avx512_vnni", "amx_int8"})
ARM = frozenset({"asimddp"})
"""Linux's names of the instructions: of each set one is enough."""


@cache
def int8_unsupported_reason() -> str:
    """Why int8 networks are not for this processor, in words; empty where they are.

    Linux says what its processor can do, and all of Apple's own have the dot product. Elsewhere nothing is assumed:
    what can't be told counts as a reason.
    """
    system, machine = platform.system(), platform.machine().lower()
    if system == "Darwin" and machine == "arm64":
        return ""
    names = {"x86_64": X86, "amd64": X86, "aarch64": ARM, "arm64": ARM}.get(machine)
    if names is None:
        return f"nothing is known of int8 on {machine or 'this machine'}"
    try:
        text = CPUINFO.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return f"{system or 'this system'} doesn't say whether its processor has VNNI or a dot product"
    keys = ("flags", "Features")
    flags = {flag for line in text.splitlines() if line.startswith(keys) for flag in line.partition(":")[2].split()}
    if not flags:
        return f"{CPUINFO} doesn't say what this processor can do"
    if flags & names:
        return ""
    return "this processor has no VNNI" if names is X86 else "this processor has no dot product (asimddp)"


def processor_name() -> str:
    """The processor, as the system calls it."""
    try:
        with CPUINFO.open(encoding="utf-8", errors="replace") as file:
            for line in file:
                if line.startswith("model name"):
                    return line.partition(":")[2].strip()
    except OSError:  # no Linux: the platform module knows
        pass
    return platform.processor() or platform.machine()
