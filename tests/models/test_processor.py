import pytest

from ciir.models import processor


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Makes this machine look like another one."""

    def pretend(system, name, cpuinfo=None):
        monkeypatch.setattr(processor.platform, "system", lambda: system)
        monkeypatch.setattr(processor.platform, "machine", lambda: name)
        monkeypatch.setattr(processor, "CPUINFO", tmp_path / "cpuinfo")
        if cpuinfo is not None:
            (tmp_path / "cpuinfo").write_text(cpuinfo)
        processor.int8_unsupported_reason.cache_clear()
        return processor.int8_unsupported_reason()

    yield pretend
    processor.int8_unsupported_reason.cache_clear()


X86 = "processor\t: 0\nmodel name\t: avx512_vnni lookalike\nflags\t\t: fpu sse2 avx2 {} erms\n"
ARM = "processor\t: 0\nBogoMIPS\t: 50.00\nFeatures\t: fp asimd {} fphp\n"


@pytest.mark.parametrize("flag", ["avx_vnni", "avx512_vnni", "amx_int8"])
def test_x86_with_a_dot_product(machine, flag):
    assert machine("Linux", "x86_64", X86.format(flag)) == ""


def test_x86_without(machine):
    assert machine("Linux", "x86_64", X86.format("avx512f")) == "this processor has no VNNI"


def test_arm(machine):
    assert machine("Linux", "aarch64", ARM.format("asimddp")) == ""
    assert "asimddp" in machine("Linux", "aarch64", ARM.format("asimdhp"))
    assert machine("Darwin", "arm64") == ""


@pytest.mark.parametrize(
    ("system", "name", "cpuinfo", "words"),
    [
        ("Windows", "AMD64", None, "Windows doesn't say"),
        ("Darwin", "x86_64", None, "Darwin doesn't say"),
        ("Linux", "x86_64", "processor: 0\n", "doesn't say what this processor can do"),
        ("Linux", "riscv64", "isa: rv64\n", "nothing is known of int8 on riscv64"),
    ],
)
def test_what_cannot_be_told_is_a_reason(machine, system, name, cpuinfo, words):
    assert words in machine(system, name, cpuinfo)
