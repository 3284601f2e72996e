"""Whatever is in a file, a reader gives a value that keeps its promises, or tells in one line which file is wrong.

`PASSERBY_FUZZ_CASES=10000 pytest -m fuzz` tries so many files with each reader; without the variable it is a few.
"""

import faulthandler
import json
import logging
import os
import signal
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from passerby.interchange.formats import all_formats
from support.untrusted.damage import CHOICES, damaged
from support.untrusted.readers import PEOPLE, READERS, Reader
from support.untrusted.soundness import check

CASES = int(os.environ.get("PASSERBY_FUZZ_CASES", "60" if os.environ.get("PASSERBY_EXAMPLES") == "thorough" else "25"))
RECORDS = os.environ.get("PASSERBY_FUZZ_RECORDS")
"""Folder in which each reader's count is kept, for the page on reliability."""
HANGS_S = 60
"""A guard, no measure of speed: the slowest case takes 0.1 s of the processor's time, which counts here."""
ELSEWHERE = "/etc/hostname: "
"""A file outside that a damaged one may name: then it is the one that cannot be read."""
LONGEST = 700
"""Characters of a message without the path."""


class HangError(BaseException):
    """A case did not end; no `Exception`, so that no reader takes it for one of its own."""


@pytest.fixture(autouse=True)
def guarded():
    """Cases that hang end the test; those that hang inside a library end the process, with the line that called it."""

    def ring(*_: object) -> None:
        raise HangError

    before = signal.signal(signal.SIGPROF, ring)
    logging.getLogger("libav").setLevel(logging.CRITICAL)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0)
    signal.signal(signal.SIGPROF, before)
    faulthandler.cancel_dump_traceback_later()


def laid_out(reader: Reader, folder: Path) -> tuple[dict[str, bytes], Path]:
    files = dict(reader.files())
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    for name in reader.folders:
        (folder / name).mkdir()
    return files, folder / next(iter(files))


def tried(reader: Reader, main: Path, told: list[str]) -> str:
    """What became of a case: read or refused. Raises `AssertionError` for a promise that is broken."""
    signal.setitimer(signal.ITIMER_PROF, HANGS_S)
    try:
        check(reader.read(main))
    except reader.refuses as error:
        told[:] = [str(error)]
    else:
        return "read"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    place = str(next(parent for parent in main.parents if parent.name == "case"))
    assert place in told[0] or told[0].startswith(ELSEWHERE), f"does not name the file: {told[0]}"
    assert len(told[0].replace(place, "")) <= LONGEST, f"shows a file at length: {told[0]}"
    return "refused"


def record_of(reader: Reader) -> Path:
    assert RECORDS is not None
    return Path(RECORDS) / f"{reader.name.replace('/', '-')}.json"


def is_recorded(reader: Reader, cases: int) -> bool:
    if RECORDS is None or not record_of(reader).is_file():
        return False
    record = json.loads(record_of(reader).read_text())
    return record.get("cases", 0) >= cases and not record.get("faults")


@pytest.mark.fuzz
@pytest.mark.parametrize("reader", READERS, ids=[reader.name for reader in READERS])
def test_damaged_files_are_read_or_refused(reader, tmp_path_factory):
    cases = max(1, round(CASES * reader.share))
    if is_recorded(reader, cases):
        pytest.skip("its cases are on record, of an earlier run of the same code")
    folder = tmp_path_factory.mktemp("fuzz") / "case"
    files, main = laid_out(reader, folder)
    broken = list(reader.broken or files)
    counts: Counter[str] = Counter()
    told: list[str] = []
    faulthandler.dump_traceback_later(120 * HANGS_S, exit=True)

    @settings(max_examples=cases, database=None, phases=(Phase.generate, Phase.shrink), suppress_health_check=list(HealthCheck))
    @given(st.integers(0, len(broken) - 1), st.binary(min_size=CHOICES, max_size=CHOICES))
    def a_case(which: int, choices: bytes) -> None:
        path = folder / broken[which]
        with path.open("wb") as file:
            file.write(damaged(files[broken[which]], path.suffix, choices))
        counts["cases"] += 1
        try:
            counts[tried(reader, main, told)] += 1
        finally:
            with path.open("wb") as file:
                file.write(files[broken[which]])

    try:
        a_case()
    except BaseException:
        counts["faults"] = 1
        raise
    finally:
        if RECORDS is not None:
            record_of(reader).write_text(json.dumps({"reader": reader.name, "share": reader.share, **counts}))


@pytest.mark.parametrize("reader", READERS, ids=[reader.name for reader in READERS])
def test_the_example_is_sound(reader, tmp_path):
    """Otherwise the damaged files would tell nothing: all of them would be refused for what was wrong before."""
    _, main = laid_out(reader, tmp_path / "case")
    assert tried(reader, main, []) == "read"


def test_every_format_that_is_read_is_tried():
    names = {reader.name for reader in READERS}
    assert len(names) == len(READERS)
    people = {name for name, _ in PEOPLE.values()}
    for form in all_formats():
        if form.read is not None:
            assert f"format {form.name}" in names
        if form.read_people is not None:
            assert form.name in people
