"""What all tests share."""

import importlib
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

from support.paths import BENCHMARKS, DATA

# Jobs in the background of a shell ignore Ctrl-C, and so would the programs that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every machine, and no example fails because a machine is slow.
settings.register_profile("passerby", deadline=None, derandomize=True)
settings.load_profile("passerby")


@pytest.fixture(scope="session", autouse=True)
def no_log_of_slow_runs() -> Iterator[None]:
    """What a test reads on standard error does not depend on the machine's speed: time stands still for the log that tells now
    and then how far a run of more than half a minute is. Tests of that log have clocks of their own."""
    from passerby.cli import terminal

    log = terminal._Log
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(terminal, "_Log", lambda: log(lambda: 0.0))
        yield


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder of the real data sets; the test is skipped where there is none."""
    if not DATA.is_dir():
        pytest.skip(f"no real data: {DATA} does not exist; set PASSERBY_DATA to their folder")
    return DATA


@pytest.fixture(scope="module")
def bench() -> Iterator[Callable[[str], ModuleType]]:
    """Imports a module of the benchmarks, whose names (`datasets`, `tables`) are none for anybody else."""
    before, benchmarks = set(sys.modules), str(BENCHMARKS)
    sys.path.insert(0, benchmarks)
    yield importlib.import_module
    sys.path.remove(benchmarks)
    for name in set(sys.modules) - before:
        if str(getattr(sys.modules[name], "__file__", None) or "").startswith(benchmarks):
            del sys.modules[name]
