"""The benchmark of sources: what its page says of outcomes, and that its zones are measured right."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import sources_page
from pages.records import Found
from passerby.simulation import SimulationOptions, simulate
from sources import pieces, watching, zones
from sources.packaging import PACKAGINGS, PLAIN


def outcome(mm: float | None, unsupported: str | None = None) -> dict[str, object]:
    found = {"about": {"text": "a film"}, "cpu_s": 1.0, "verdict": "accepted", "registered": 3, "mm": mm, "deg": 0.1}
    return found if unsupported is None else found | {"unsupported": unsupported}


def goal(*outcomes: dict[str, object]) -> list[str]:
    """Of the plain film's error of 10 mm and these of the first packagings."""
    keys = [PLAIN.key, *(packaging.key for packaging in PACKAGINGS)]
    done = dict(zip(keys, [outcome(10.0), *outcomes], strict=False))
    return sources_page.tabulate_containers(dict.fromkeys(keys), done).goals[0]


def test_a_packaging_gives_the_rig_of_the_plain_film_or_one_line() -> None:
    assert goal(*[outcome(10.9)] * 11, outcome(None, "no encoder"))[-1] == "aim"
    assert goal(*[outcome(10.9)] * 11, outcome(11.1))[1::3] == ["11 of 12", "**missed**"]
    assert goal(*[outcome(10.9)] * 11, outcome(None))[-1] == "**missed**"
    assert goal(outcome(10.0))[1::3] == ["1 of 12", "2 of 13 run"]
    assert len({packaging.key for packaging in (PLAIN, *PACKAGINGS)}) == 13


def test_zones_of_the_true_rig_have_their_true_sides() -> None:
    rig = simulate(SimulationOptions(preset="terrace", seconds=2.0, seed=1)).rig
    exact = zones.zone_errors(rig, rig, np.random.default_rng(0))
    assert len(exact) == 4 * zones.ZONES
    assert max(exact) < 1e-6
    larger = zones.zone_errors(rig.moved(np.eye(3), np.zeros(3), 1.1), rig, np.random.default_rng(0))
    # Every length is a tenth longer; corners that come to lie too far away have none.
    assert [value for value in larger if np.isfinite(value)] == pytest.approx([10.0] * sum(np.isfinite(larger)), abs=1e-6)


def rig(mm: float | None, text: str, **others: object) -> dict[str, object]:
    about = {"about": {"text": text}, "cpu_s": 1.0, "verdict": "accepted", "registered": 4, "mm": mm, "deg": 0.1}
    return {**about, "offset_ms": 12.0, "gaps": [], **others}


def rows(found: Callable[..., Found], done: dict[str, dict[str, object]]) -> list[list[str]]:
    return found(dict.fromkeys(done), done).goals


def test_streams_are_compared_with_the_files_and_the_true_offsets() -> None:
    files = rig(10.0, "files")
    recording = {"cameras": {"C1": {"gaps_s": [2.0], "clock": "sender"}}}
    assert rows(sources_page.tabulate_streams, {"files": files}) == []
    error, offset = rows(sources_page.tabulate_streams, {"files": files, "streams": rig(12.0, "streams", recording=recording)})
    assert (error[1], error[-1]) == ("1.20 x, accepted", "acceptable")
    assert (offset[1], offset[-1]) == ("12 ms", "aim")
    for worse in ({"verdict": "doubtful"}, {"mm": 13.1}, {"mm": None}):
        error, _ = rows(sources_page.tabulate_streams, {"files": files, "streams": rig(10.0, "streams") | worse})
        assert error[-1] == "**missed**"
    _, offset = rows(sources_page.tabulate_streams, {"files": files, "streams": rig(10.0, "streams") | {"offset_ms": None}})
    assert offset[-1] == "**missed**"


@pytest.mark.parametrize(
    ("gaps", "said", "verdict"),
    [
        ([["C1", 1, 20.0], ["C2", 2, 20.0]], "3 of 3", "aim"),
        ([["C1", 1, 20.0], ["C2", 1, 10.0]], "1 of 3", "**missed**"),
        ([["C1", 1, 20.0], ["C1", 1, 20.0], ["C2", 2, 20.0]], "2 of 3", "**missed**"),
    ],
)
def test_gaps_have_to_be_reported_once(gaps: list[list[object]], said: str, verdict: str) -> None:
    lost = [["C1", 3], ["C1", 4], ["C2", 2], ["C2", 6]]
    done = {"files": rig(10.0, "files"), "pieces": rig(10.2, "pieces", lost=lost, gaps=gaps)}
    error, once = rows(sources_page.tabulate_pieces, done)
    assert (error[1], error[-1]) == ("1.02 x, accepted", "aim")
    assert (once[1], once[-1]) == (said, verdict)


def test_pieces_that_are_lost_lie_inside_the_recordings(tmp_path: Path) -> None:
    counts = {"C1": 10, "C2": 4}
    lost = pieces.drawn(counts, np.random.default_rng(5))
    assert len(set(lost)) == 2
    assert all(0 < number < counts[name] - 1 for name, number in lost)
    files = {name: [tmp_path / f"{name}{number}" for number in range(count)] for name, count in counts.items()}
    for path in (path for paths in files.values() for path in paths):
        path.write_bytes(b"film")
    pieces.lose(files, lost)
    left = [path for paths in files.values() for path in paths if path.exists()]
    assert len(left) == 13
    assert sum(path.read_bytes() == b"film" for path in left) == 12


def test_the_worst_detector_decides_about_processing_time() -> None:
    def case(detector: str, now_s: float) -> dict[str, object]:
        one = {"pictures": 100, "boxes": 300}
        about = {"detector": detector, "seconds": 20.0, "against": watching.EARLIER}
        return {"about": about, "cpu_s": 1.0, "earlier": one | {"cpu_s": 10.0}, "now": one | {"cpu_s": now_s}}

    ((_, said, *_, verdict),) = rows(
        sources_page.tabulate_watching, {"a": case("background", 4.0), "b": case("yolox-nano", 7.9)}
    )
    assert (said, verdict) == ("0.40 x (background), 0.79 x (yolox-nano)", "acceptable")
    ((*_, verdict),) = rows(sources_page.tabulate_watching, {"a": case("background", 4.0), "b": case("yolox-nano", 9.0)})
    assert verdict == "**missed**"
    assert rows(sources_page.tabulate_watching, {}) == []
