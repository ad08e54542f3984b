import pytest

from ciir.models import processor


@pytest.fixture
def imitate(tmp_path, monkeypatch):
    """Makes this machine look like another one, and returns the reason against int8."""

    def imitate_machine(system, name, cpuinfo=None):
        monkeypatch.setattr(processor.platform, "system", lambda: system)
        monkeypatch.setattr(processor.platform, "machine", lambda: name)
        monkeypatch.setattr(processor, "CPUINFO", tmp_path / "cpuinfo")
        if cpuinfo is not None:
            (tmp_path / "cpuinfo").write_text(cpuinfo)
        processor.int8_unsupported_reason.cache_clear()
        return processor.int8_unsupported_reason()

    yield imitate_machine
    processor.int8_unsupported_reason.cache_clear()


X86 = "processor\t: 0\nmodel name\t: avx512_vnni in its name only\nflags\t\t: fpu sse2 avx2 {} erms\n"
ARM = "processor\t: 0\nBogoMIPS\t: 50.00\nFeatures\t: fp asimd {} fphp\n"


@pytest.mark.parametrize("flag", ["avx_vnni", "avx512_vnni", "amx_int8"])
def test_x86_with_a_dot_product(imitate, flag):
    assert imitate("Linux", "x86_64", X86.format(flag)) == ""


def test_x86_without_a_dot_product(imitate):
    assert imitate("Linux", "x86_64", X86.format("avx512f")) == "this processor has no VNNI"


def test_arm(imitate):
    assert imitate("Linux", "aarch64", ARM.format("asimddp")) == ""
    assert "asimddp" in imitate("Linux", "aarch64", ARM.format("asimdhp"))
    assert imitate("Darwin", "arm64") == ""


@pytest.mark.parametrize(
    ("system", "name", "cpuinfo", "words"),
    [
        ("Windows", "AMD64", None, "Windows doesn't list"),
        ("Darwin", "x86_64", None, "Darwin doesn't list"),
        ("Linux", "x86_64", "processor: 0\n", "doesn't list this processor's instructions"),
        ("Linux", "riscv64", "isa: rv64\n", "int8 was not tried on riscv64"),
    ],
)
def test_int8_is_unsupported_where_instructions_are_unknown(imitate, system, name, cpuinfo, words):
    assert words in imitate(system, name, cpuinfo)
