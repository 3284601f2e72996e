"""The benchmark of scenes without intrinsics: what is withheld, what its figures mean, and a page that grows case by case."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import SolverFigures
from passerby.core.observations import Boxes, CameraObservations
from passerby.interchange.rig_toml import write_rig

Bench = Callable[[str], ModuleType]


def calibrated(mm: float, focal: dict[str, float], verdict: str = "doubtful", **more: Any) -> dict[str, Any]:
    """An outcome as `lenses.outcomes` makes it."""
    lenses = {name: {"focal_percent": percent, "sigma_percent": 2.0} for name, percent in focal.items()}
    return {"verdict": verdict, "mm": mm, "deg": mm / 100, "registered": 2, "cpu_s": mm, "lenses": lenses} | more


def case(estimated: dict[str, Any], known: dict[str, Any] | None = None, **about: Any) -> dict[str, Any]:
    about = {"preset": "terrace", "identities_known": False} | about
    known = known or calibrated(10.0, {}, "accepted")
    return {
        "about": about,
        "cameras": 2,
        "withheld": ["C1", "C2"],
        "off_centre_deg": 0.1,
        "known": known,
        "estimated": estimated,
    }


def test_a_camera_that_is_not_registered_is_infinitely_wrong(bench: Bench) -> None:
    summary = bench("lenses_summary").Summary([case(calibrated(20.0, {"C1": -3.0}, registered=1))])
    assert summary.focal_errors == [3.0, math.inf]
    assert summary.ratios("mm") == [math.inf]
    assert summary.registered == (1, 2)


def test_the_ratio_of_both_is_that_of_what_grew_more(bench: Bench) -> None:
    cases = [case(calibrated(15.0, {}) | {"deg": 0.4}), case(calibrated(30.0, {})), case({**calibrated(1.0, {})})]
    refused = {"verdict": "refused", "registered": 0, "cpu_s": 1.0, "lenses": {}}
    summary = bench("lenses_summary").Summary([*cases, case(refused), case(calibrated(5.0, {}), known=refused)])
    assert summary.ratios("mm", "deg") == pytest.approx([4.0, 3.0, 0.1, math.inf])
    assert summary.ratios("mm") == pytest.approx([1.5, 3.0, 0.1, math.inf])
    assert summary.errors("estimated")[0] == 15.0
    assert summary.time_ratios == pytest.approx([1.5, 3.0, 0.1, 0.1, 5.0])


def test_the_share_within_is_that_of_so_many_cases(bench: Bench) -> None:
    within = bench("lenses_summary").within
    assert within(range(1, 31), 0.9) == 27
    assert within([5.0], 0.95) == 5.0
    assert math.isnan(within([], 0.5))


def test_only_accepted_scenes_count_as_wrongly_accepted(bench: Bench) -> None:
    far, near = {"C1": 0.0, "C2": -8.1}, {"C1": 7.9}
    cases = [case(calibrated(9.0, focal, verdict)) for focal in (far, near) for verdict in ("accepted", "doubtful")]
    assert bench("lenses_summary").Summary(cases).accepted_wrong == 1


def test_errors_are_counted_in_stated_sigmas(bench: Bench) -> None:
    assert bench("lenses_summary").Summary([case(calibrated(9.0, {"C1": -3.0, "C2": 1.0}))]).in_sigmas == [1.5, 0.5]


def test_every_part_has_all_presets_and_the_quick_cases_first(bench: Bench) -> None:
    cases = bench("lenses.simulated").cases("varied", 2)
    assert [one.identities_known for one in cases.values()] == [True] * 6 + [False] * 6
    assert {one.preset for one in cases.values()} == {"terrace", "basketball", "construction"}
    options = cases["basketball 300001 identities unknown"].options
    assert (options.unrelated_ids, options.clock_offsets, options.lenses, options.seed) == (True, 2.0, "varied", 300001)
    assert bench("lenses.simulated").cases("shared", 1)["terrace 300000 identities known"].options.lenses == "shared"
    assert bench("lenses.simulated").cases("keypoints", 1)["terrace 300000 identities known"].options.joint_noise_px == 2.0


@pytest.mark.parametrize(
    ("part", "withheld", "group"),
    [("varied", "C1 C2 C3 C4", None), ("shared", "C1 C2 C3 C4", "one model"), ("mixed", "C2 C4", None)],
)
def test_withheld_lenses_are_unknown_and_the_others_true(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, part: str, withheld: str, group: str | None
) -> None:
    module = bench("lenses.simulated")
    stated: list[dict[str, Lens]] = []
    monkeypatch.setattr(module, "SECONDS", 1.0)
    case = module.cases(part, 1)["terrace 300000 identities known"]
    truth = module.simulate(case.options).rig

    def record(lenses: dict[str, Lens], *_: Any, **__: Any) -> Any:
        stated.append(lenses)
        seen = dict.fromkeys(truth.names, CameraObservations(Boxes.empty()))
        return SimpleNamespace(rig=truth, verdict="accepted", doubts=(), observations=seen, figures=SolverFigures())

    monkeypatch.setattr(module, "calibrate_observations", record)
    found = module.work(case)
    known, estimated = stated
    assert not any(lens.uncalibrated for lens in known.values())
    assert [name for name, lens in estimated.items() if lens.uncalibrated] == withheld.split() == found["withheld"]
    assert {lens.group for lens in estimated.values() if lens.uncalibrated} == {group}
    assert [*found["estimated"]["lenses"]] == withheld.split()
    assert found["estimated"]["mm"] == pytest.approx(0, abs=1e-6)


def test_what_cannot_be_calibrated_is_refused(bench: Bench) -> None:
    from passerby.common.errors import InputError

    def fail() -> Any:
        raise InputError("no people")

    found = bench("lenses.outcomes").timed_outcome(fail, Rig(()))
    assert (found["verdict"], found["codes"], found["registered"]) == ("refused", ["no people"], 0)


def test_a_principal_point_off_the_centre_turns_the_camera(bench: Bench) -> None:
    lens = Lens((640, 480), np.array([[300.0, 0, 320 + 300 * np.tan(0.02)], [0, 300.0, 240], [0, 0, 1]]), np.zeros(4))
    centred = Lens((640, 480), np.array([[300.0, 0, 320], [0, 300.0, 240], [0, 0, 1]]), np.zeros(4))
    rig = Rig((Camera("A", lens), Camera("B", centred)))
    assert bench("lenses.outcomes").off_centre_deg(rig, "A") == pytest.approx(np.degrees(0.02))
    assert bench("lenses.outcomes").off_centre_deg(rig, "AB") == pytest.approx(np.degrees(0.01))


def test_a_scene_without_lenses_states_the_image_sizes(bench: Bench, tmp_path: Path) -> None:
    lens = Lens((640, 480), np.array([[500.0, 0, 352], [0, 500.0, 240], [0, 0, 1]]), np.zeros(4))
    write_rig(tmp_path / "rig.toml", Rig((Camera("A", lens, Pose(np.eye(3), np.zeros(3))),)))
    (tmp_path / "scene.toml").write_text('[cameras.A]\nintrinsics = "rig.toml"\ntracks = "a.txt"\n')
    path = bench("lenses.recorded").without_lenses(tmp_path / "scene.toml")
    assert tomllib.loads(path.read_text()) == {"cameras": {"A": {"tracks": "a.txt", "image_size": [640, 480]}}}


def test_a_stopped_run_goes_on(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`dict` is the work: its outcome is what it is given, so that a case that is run again would show."""
    run_cases, kept = bench("pages.cases").run_cases, bench("pages.kept").Kept
    monkeypatch.setattr(bench("pages.kept"), "code_digest", lambda *folders: "code")
    cases = {name: {"figure": number} for number, name in enumerate("abc")}
    first = run_cases(kept(tmp_path, ("lenses",)), "part", cases, dict, 1)
    assert next(first) == {}
    assert next(first) == {"a": {"figure": 0}}
    first.close()
    changed = {name: {"figure": 7} for name in cases}
    again = [*run_cases(kept(tmp_path, ("lenses",)), "part", changed, dict, 1)]
    assert again[0] == {"a": {"figure": 0}}
    assert again[-1] == {"a": {"figure": 0}, "b": {"figure": 7}, "c": {"figure": 7}}
    assert next(run_cases(kept(tmp_path, ("lenses",)), "other part", cases, dict, 1)) == {}


def test_the_page_says_what_is_finished_and_what_is_not(bench: Bench) -> None:
    module = bench("lenses_page")
    cases = bench("lenses.simulated").cases("varied", 1)
    done = {
        "terrace 300000 identities known": case(calibrated(20.0, {"C1": 1.0, "C2": -2.0}), identities_known=True),
        "terrace 300000 identities unknown": case(calibrated(30.0, {"C1": 1.0, "C2": -9.0}, "accepted")),
    }
    found = module.tabulate("varied", cases, done)
    assert found.run.startswith("2 of 6 cases; ")
    assert [row[1] for row in found.tables["Scenes"].rows] == ["1 of 3", "1 of 1", "1 of 3", "1 of 1"]
    goals = {row[0]: row[1:] for row in found.goals}
    name = "boxes, each camera its own lens, identities unknown"
    assert goals[f"{name}: focal error, 95 %"] == ["9.00 % (1 of 3 scenes)", "8 %", "5 %", "**missed**"]
    assert goals[f"{name}: accepted with a focal error over 8 %"][-1] == "**missed**"
    assert goals[f"{name}: rig's error, times that with true intrinsics, 90 % of scenes"][0] == "3.00 x (1 of 3 scenes)"
    mixed = module.tabulate("mixed", cases, done)
    assert [row[0] for row in mixed.goals] == ["mixed: processor time, times that with the true intrinsics"]


def test_a_real_set_is_held_against_its_goal(bench: Bench) -> None:
    tables = bench("lenses_tables")
    estimated = calibrated(100.0, {"C1": 1.5, "C2": 0.5}) | {"deg": 0.3}
    row, measured = tables.recorded_goals({"wildtrack, identities known": case(estimated)})
    assert (row[-1], measured[-1]) == ("**missed**", "**missed**")  # 100 mm; nothing is known of points
    measuring = estimated | {"mm": 70.0, "points_mm": 20.0, "ground_mm": 60.0}
    known = calibrated(10.0, {}) | {"points_mm": 5.0, "ground_mm": 50.0}
    row, measured = tables.recorded_goals({"wildtrack, identities known": case(measuring) | {"known": known}})
    assert (row[-1], measured[1], measured[-1]) == ("acceptable", "20.0 mm, 1.20 x", "acceptable")
    left = case(calibrated(9000.0, {"V1": 2.0, "V4": -40.0})) | {"withheld": ["V1", "V4"]}
    (row,) = tables.recorded_goals({"pets2009, identities known": left})
    assert row[0] == "pets2009, identities known, without V4 and V7"
    assert row[-1] == "aim"
