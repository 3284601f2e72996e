"""The benchmark of scale: what its cases state is true, and what its page says of outcomes."""

from __future__ import annotations

import numpy as np
import pytest

import scale_page
from passerby.simulation import simulate
from scale import simulated


def outcome(known: str, scale_percent: float | None, sigma_percent: float = 1.0) -> dict[str, object]:
    return {
        "about": {"known": known, "preset": "terrace"}, "cpu_s": 1.0, "verdict": "accepted", "cameras": 4, "registered": 4,
        "codes": [], "sigma_percent": sigma_percent, "scale_percent": scale_percent, "mm": 20.0, "deg": 0.1,
    }  # fmt: skip


def found(part: str, known: str, *scales: float | None) -> scale_page.Found:
    cases = dict(list(simulated.cases(part, len(scales)).items())[: len(scales)])
    return scale_page.tabulate(part, cases, {str(n): outcome(known, one) for n, one in enumerate(scales)})


def goal(part: str, known: str, *scales: float | None) -> list[str]:
    return found(part, known, *scales).goals[0]


def test_the_median_decides_and_a_scene_without_a_scale_counts_as_infinite() -> None:
    assert goal("plan", "two points", 0.1, -0.3, 0.9)[-1] == "aim"
    assert goal("plan", "two points", 0.1, -0.5, 0.9)[-1] == "acceptable"
    assert goal("plan", "two points", 0.1, -0.7, 0.9)[-1] == "**missed**"
    assert goal("plan", "two points", 0.1, None, None)[-1] == "**missed**"


def test_signed_errors_and_sigmas_are_goals_of_their_own() -> None:
    rows = found("nobody", "nothing", 2.0, 2.0, -1.0).goals
    assert [row[1] for row in rows] == ["2.00 % (3 scenes)", "1.00 % (3 scenes)", "2.00 (3 scenes)"]
    assert [row[-1] for row in rows] == ["aim", "aim", "aim"]


def test_upper_bodies_want_many_within_two_sigmas() -> None:
    rows = {row[0]: row for row in found("upper", "upper bodies", 1.0, 1.5, 5.0).goals}
    assert rows["upper bodies: within two stated sigmas"][1:] == ["66.67 % (3 scenes)", "90 %", "90 %", "**missed**"]
    assert rows["upper bodies: figures that are no numbers"][-1] == "aim"


def test_cases_differ_and_are_as_many_as_asked_for() -> None:
    for part, (kinds, presets, _) in simulated.KNOWN.items():
        assert len(simulated.cases(part, 3)) == 3 * len(kinds) * len(presets)


@pytest.mark.slow
def test_what_a_case_states_is_true_but_for_the_clicks(tmp_path) -> None:
    case = simulated.ScaleCase("two points", "terrace", 3)
    scene = simulate(case.options)
    plan = simulated._tables(case, scene, np.random.default_rng(0), tmp_path)["world"]["plan"]
    apart = plan["metres_per_pixel"] * np.linalg.norm(np.subtract(*(point["at"] for point in plan["points"])))
    truth = np.linalg.norm(np.subtract(*simulated._far_points(scene)))
    assert apart == pytest.approx(truth, abs=6 * simulated.CLICK_PX * plan["metres_per_pixel"])
    assert all(len(point["pixels"]) > 1 for point in plan["points"])
    person = simulated._tables(simulated.ScaleCase("person", "terrace", 3), scene, np.random.default_rng(0), tmp_path)
    assert person["scale"]["people"][0]["height_m"] in scene.heights.values()
