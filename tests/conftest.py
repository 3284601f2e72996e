"""What all tests share."""

import importlib
import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from support.browser import CHROMIUM, FLAGS, START_S
from support.paths import BENCHMARKS, DATA, TESTS

# Jobs in the background of a shell ignore Ctrl-C, and so would the programs that tests interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples on every machine, and no example fails because a machine is slow; tests that set no number of examples have
# few in the quick tier, and all of them where PASSERBY_EXAMPLES=thorough says so.
for profile, examples in (("quick", 25), ("thorough", 100)):
    settings.register_profile(
        profile, deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True, max_examples=examples
    )
settings.load_profile(os.environ.get("PASSERBY_EXAMPLES", "quick"))

# Tests name the networks that they want (`support.paths.MODELS`): what else lies on this computer decides none of them.
os.environ.pop("PASSERBY_MODELS", None)

EVIDENCE = ("benchmarks/baselines", "benchmarks/paper", "benchmarks/peers", "benchmarks/reliability", "docs/test_examples.py",
            "docs/test_site.py", "real")  # fmt: skip
"""Where the tests are evidence: of real data, of the benchmark's pages, of other programs, of the documentation's examples."""
EVIDENCE_FIXTURES = frozenset({"data_root"})
TORCH = ("checkpoints", "export", "losses", "sampling", "training")
"""Trainings, which need PyTorch."""
SYSTEM = (
    "cli/test_resume.py",
    "report/test_browser.py",
    "report/test_site_browser.py",
    *(f"training/test_{name}.py" for name in TORCH),
)
"""Where they are of the system: trainings, a browser, processes that die."""
SYSTEM_FIXTURES = frozenset({"browser", "calibrated", "calibration", "calibrations"})
"""Who asks for one of these asks for a calibration, or for a program of its own."""


def tier_of(item: pytest.Item) -> str:
    """`unit`, `system` or `evidence`: by where a test lies, what it asks for, and what it says itself."""
    path = item.path.relative_to(TESTS).as_posix()
    asked = set(getattr(item, "fixturenames", ()))
    if item.get_closest_marker("unit"):
        return "unit"
    if path.startswith(EVIDENCE) or asked & EVIDENCE_FIXTURES or item.get_closest_marker("evidence"):
        return "evidence"
    if path.startswith(SYSTEM) or asked & SYSTEM_FIXTURES or item.get_closest_marker("system"):
        return "system"
    return "unit"


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark each test with its tier, and as slow what is of the upper tiers and no smoke; the longest files begin."""
    quick, work = "not slow" in config.option.markexpr, Counter[Path]()
    for item in items:
        tier = tier_of(item)
        item.add_marker(tier)
        if tier != "unit" and not item.get_closest_marker("smoke"):
            item.add_marker("slow")
        if not (quick and item.get_closest_marker("slow")):
            work[item.path] += 1 if tier == "unit" else 20
    # A stable order: the tests of a file stay together and as they are.
    items.sort(key=lambda item: (-work[item.path], item.path))


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


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A real browser; playwright runs once in a process."""
    playwright = pytest.importorskip("playwright.sync_api", reason="no playwright: install the extra dev")
    with playwright.sync_playwright() as running:
        browser = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS, timeout=1000 * START_S)
        BROWSERS.append(browser)
        yield browser
        BROWSERS.remove(browser)
        browser.close()


BROWSERS: list[Any] = []
"""The one that runs, if any."""


@pytest.fixture(scope="module", autouse=True)
def no_page_outlives_its_file() -> Iterator[None]:
    """Pages that stay open go on drawing."""
    yield
    for context in [context for browser in BROWSERS for context in browser.contexts]:
        context.close()


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
