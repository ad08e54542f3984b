"""The engines of a batch."""

import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from ciir.errors import InvalidOption
from ciir.service.batch import engines


@pytest.mark.parametrize("address", ["scheduler", "tcp://scheduler", "tcp://scheduler:port", "http://scheduler:8786"])
def test_an_address_that_is_none_is_refused_at_once(monkeypatch, address):
    monkeypatch.setattr(engines, "Client", None)  # one that refuses an address itself takes a minute to end
    with pytest.raises(InvalidOption, match=f"no scheduler answers at {address} .* such as tcp://10.0.0.1:8786$"):
        engines.connect(address)


def find_blocked():
    """The signals that a new process has blocked."""
    code = "import signal; print(*map(int, signal.pthread_sigmask(signal.SIG_BLOCK, [])))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout  # noqa: S603 - our own
    return {*map(int, shown.split())}


@pytest.mark.parametrize("is_main", [True, False])
def test_ctrl_c_while_workers_start_is_raised_when_they_have(is_main):
    """Whichever thread the system gives it to. Processes that new threads start, as Dask's do, don't get it."""
    blocked = []

    def start(before, new):
        with engines._hold_interrupts():
            if is_main:
                signal.raise_signal(signal.SIGINT)
            else:
                before.submit(signal.raise_signal, signal.SIGINT).result()
            blocked.append(new.submit(find_blocked).result())

    with ThreadPoolExecutor(1) as before, ThreadPoolExecutor(1) as new:
        before.submit(int).result()
        with pytest.raises(KeyboardInterrupt):
            start(before, new)
    assert blocked == [{signal.SIGINT}]
    assert find_blocked() == set()


def test_workers_start_without_ctrl_c():
    handler = signal.getsignal(signal.SIGINT)
    with engines._hold_interrupts():
        pass
    assert signal.getsignal(signal.SIGINT) is handler
