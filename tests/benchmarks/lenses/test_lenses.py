"""The benchmark of scenes without intrinsics: what is withheld, what its figures mean, and a page that grows case by case."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import lenses_page
import lenses_tables
from lenses import outcomes, recorded, simulated
from lenses_summary import Summary, within
from pages import kept as kept_module
from pages.cases import run_cases
from pages.kept import Kept
from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.figures import SolverFigures
from passerby.core.observations import Boxes, CameraObservations
from passerby.interchange.rig_toml import write_rig


def calibrated(mm: float, focal: dict[str, float], verdict: str = "doubtful", **more: Any) -> dict[str, Any]:
    """An outcome as `lenses.outcomes` makes it."""
    lenses = {name: {"focal_percent": percent, "sigma_percent": 2.0} for name, percent in focal.items()}
    return {"verdict": verdict, "mm": mm, "deg": mm / 100, "registered": 2, "cpu_s": mm, "lenses": lenses} | more


def case(estimated: dict[str, Any], known: dict[str, Any] | None = None, **about: Any) -> dict[str, Any]:
    return {
        "about": {"preset": "terrace", "identities_known": False} | about, "cameras": 2, "withheld": ["C1", "C2"],
        "off_centre_deg": 0.1, "known": known or calibrated(10.0, {}, "accepted"), "estimated": estimated,
    }  # fmt: skip


def test_a_camera_that_is_not_registered_is_infinitely_wrong():
    summary = Summary([case(calibrated(20.0, {"C1": -3.0}, registered=1))])
    assert summary.focal_errors == [3.0, math.inf]
    assert summary.ratios("mm") == [math.inf]
    assert summary.registered == (1, 2)
    assert Summary([case(calibrated(9.0, {"C1": -3.0, "C2": 1.0}))]).in_sigmas == [1.5, 0.5]


def test_the_ratio_of_both_is_that_of_what_grew_more():
    cases = [case(calibrated(15.0, {}) | {"deg": 0.4}), case(calibrated(30.0, {})), case({**calibrated(1.0, {})})]
    refused = {"verdict": "refused", "registered": 0, "cpu_s": 1.0, "lenses": {}}
    summary = Summary([*cases, case(refused), case(calibrated(5.0, {}), known=refused)])
    assert summary.ratios("mm", "deg") == pytest.approx([4.0, 3.0, 0.1, math.inf])
    assert summary.ratios("mm") == pytest.approx([1.5, 3.0, 0.1, math.inf])
    assert summary.errors("estimated")[0] == 15.0
    assert summary.time_ratios == pytest.approx([1.5, 3.0, 0.1, 0.1, 5.0])


def test_the_share_within_is_that_of_so_many_cases():
    assert within(range(1, 31), 0.9) == 27
    assert within([5.0], 0.95) == 5.0
    assert math.isnan(within([], 0.5))


def test_only_accepted_scenes_count_as_wrongly_accepted():
    far, near = {"C1": 0.0, "C2": -8.1}, {"C1": 7.9}
    cases = [case(calibrated(9.0, focal, verdict)) for focal in (far, near) for verdict in ("accepted", "doubtful")]
    assert Summary(cases).accepted_wrong == 1


def test_every_part_has_all_presets_and_the_quick_cases_first():
    cases = simulated.cases("varied", 2)
    assert [one.identities_known for one in cases.values()] == [True] * 6 + [False] * 6
    assert {one.preset for one in cases.values()} == {"terrace", "basketball", "construction"}
    options = cases["basketball 300001 identities unknown"].options
    assert (options.unrelated_ids, options.clock_offsets, options.lenses, options.seed) == (True, 2.0, "varied", 300001)
    assert simulated.cases("shared", 1)["terrace 300000 identities known"].options.lenses == "shared"
    assert simulated.cases("keypoints", 1)["terrace 300000 identities known"].options.joint_noise_px == 2.0


@pytest.mark.parametrize(
    ("part", "withheld", "group"),
    [("varied", "C1 C2 C3 C4", None), ("shared", "C1 C2 C3 C4", "one model"), ("mixed", "C2 C4", None)],
)
def test_withheld_lenses_are_unknown_and_the_others_true(
    monkeypatch: pytest.MonkeyPatch, part: str, withheld: str, group: str | None
):
    stated: list[dict[str, Lens]] = []
    monkeypatch.setattr(simulated, "SECONDS", 1.0)
    one = simulated.cases(part, 1)["terrace 300000 identities known"]
    truth = simulated.simulate(one.options).rig

    def record(lenses: dict[str, Lens], *_: Any, **__: Any) -> Any:
        stated.append(lenses)
        seen = dict.fromkeys(truth.names, CameraObservations(Boxes.empty()))
        return SimpleNamespace(rig=truth, verdict="accepted", doubts=(), observations=seen, figures=SolverFigures())

    monkeypatch.setattr(simulated, "calibrate_observations", record)
    found = simulated.work(one)
    known, estimated = stated
    assert not any(lens.uncalibrated for lens in known.values())
    assert [name for name, lens in estimated.items() if lens.uncalibrated] == withheld.split() == found["withheld"]
    assert {lens.group for lens in estimated.values() if lens.uncalibrated} == {group}
    assert [*found["estimated"]["lenses"]] == withheld.split()
    assert found["estimated"]["mm"] == pytest.approx(0, abs=1e-6)


def test_what_cannot_be_calibrated_is_refused():
    def fail() -> Any:
        raise InputError("no people")

    found = outcomes.timed_outcome(fail, Rig(()))
    assert (found["verdict"], found["codes"], found["registered"]) == ("refused", ["no people"], 0)


def lens(focal: float, middle: float) -> Lens:
    return Lens((640, 480), np.array([[focal, 0, middle], [0, focal, 240], [0, 0, 1]]), np.zeros(4))


def test_a_principal_point_off_the_centre_turns_the_camera():
    rig = Rig((Camera("A", lens(300.0, 320 + 300 * np.tan(0.02))), Camera("B", lens(300.0, 320))))
    assert outcomes.off_centre_deg(rig, "A") == pytest.approx(np.degrees(0.02))
    assert outcomes.off_centre_deg(rig, "AB") == pytest.approx(np.degrees(0.01))


def test_a_scene_without_lenses_states_the_image_sizes(tmp_path: Path):
    write_rig(tmp_path / "rig.toml", Rig((Camera("A", lens(500.0, 352), Pose(np.eye(3), np.zeros(3))),)))
    (tmp_path / "scene.toml").write_text('[cameras.A]\nintrinsics = "rig.toml"\ntracks = "a.txt"\n')
    path = recorded.without_lenses(tmp_path / "scene.toml")
    assert tomllib.loads(path.read_text()) == {"cameras": {"A": {"tracks": "a.txt", "image_size": [640, 480]}}}


def test_a_stopped_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """`dict` is the work: its outcome is what it is given, so that a case that is run again would show."""
    monkeypatch.setattr(kept_module, "code_digest", lambda *folders: "code")
    cases = {name: {"figure": number} for number, name in enumerate("abc")}
    first = run_cases(Kept(tmp_path, ("lenses",)), "part", cases, dict, 1)
    assert next(first) == {}
    assert next(first) == {"a": {"figure": 0}}
    first.close()
    changed = {name: {"figure": 7} for name in cases}
    again = [*run_cases(Kept(tmp_path, ("lenses",)), "part", changed, dict, 1)]
    assert again[0] == {"a": {"figure": 0}}
    assert again[-1] == {"a": {"figure": 0}, "b": {"figure": 7}, "c": {"figure": 7}}
    assert next(run_cases(Kept(tmp_path, ("lenses",)), "other part", cases, dict, 1)) == {}


def test_the_page_says_what_is_finished_and_what_is_not():
    cases = simulated.cases("varied", 1)
    done = {
        "terrace 300000 identities known": case(calibrated(20.0, {"C1": 1.0, "C2": -2.0}), identities_known=True),
        "terrace 300000 identities unknown": case(calibrated(30.0, {"C1": 1.0, "C2": -9.0}, "accepted")),
    }
    found = lenses_page.tabulate("varied", cases, done)
    assert found.run.startswith("2 of 6 cases; ")
    assert [row[1] for row in found.tables["Scenes"].rows] == ["1 of 3", "1 of 1", "1 of 3", "1 of 1"]
    goals = {row[0]: row[1:] for row in found.goals}
    name = "boxes, each camera its own lens, identities unknown"
    assert goals[f"{name}: focal error, 95 %"] == ["9.00 % (1 of 3 scenes)", "8 %", "5 %", "**missed**"]
    assert goals[f"{name}: accepted with a focal error over 8 %"][-1] == "**missed**"
    assert goals[f"{name}: rig's error, times that with true intrinsics, 90 % of scenes"][0] == "3.00 x (1 of 3 scenes)"
    mixed = lenses_page.tabulate("mixed", cases, done)
    assert [row[0] for row in mixed.goals] == ["mixed: processor time, times that with the true intrinsics"]


def test_a_real_set_is_held_against_its_goal():
    estimated = calibrated(100.0, {"C1": 1.5, "C2": 0.5}) | {"deg": 0.3}
    row, measured = lenses_tables.recorded_goals({"wildtrack, identities known": case(estimated)})
    assert (row[-1], measured[-1]) == ("**missed**", "**missed**")  # 100 mm; nothing is known of points
    measuring = estimated | {"mm": 70.0, "points_mm": 20.0, "ground_mm": 60.0}
    known = calibrated(10.0, {}) | {"points_mm": 5.0, "ground_mm": 50.0}
    row, measured = lenses_tables.recorded_goals({"wildtrack, identities known": case(measuring) | {"known": known}})
    assert (row[-1], measured[1], measured[-1]) == ("acceptable", "20.0 mm, 1.20 x", "acceptable")
    left = case(calibrated(9000.0, {"V1": 2.0, "V4": -40.0})) | {"withheld": ["V1", "V4"]}
    (row,) = lenses_tables.recorded_goals({"pets2009, identities known": left})
    assert row[0] == "pets2009, identities known, without V4 and V7"
    assert row[-1] == "aim"
