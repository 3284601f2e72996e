"""Lengths that only check a rig: they change nothing in it, and let none be accepted that contradicts them."""

import numpy as np
import pytest

from passerby.calibration.alignment.lengths import check_lengths, findings_of_checks
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.errors import InputError
from passerby.core.figures import CheckedLength
from passerby.scene.scale_tables import CheckTable
from passerby.simulation import SimulationOptions, simulate


@pytest.fixture(scope="module")
def small():
    return simulate(SimulationOptions(seed=4000, seconds=12.0, box_noise=0.02))


def calibrated(simulated, checks, **scale):
    boxes = {
        name: seen.boxes.take(np.flatnonzero(seen.boxes.identity > 0)) for name, seen in simulated.observations.cameras.items()
    }
    association = {"mode": "given", "max_offset_s": 0}
    return calibrate_observations(simulated.rig, boxes, fps=5, association=association, scale={"checks": checks, **scale})


def marked(rig, factor=1.0, **more):
    """A length of four metres on the ground, marked in two cameras."""
    middle = np.mean([camera.centre for camera in rig], axis=0) * [1, 1, 0]
    ends = middle + np.array([[-2.0, 0, 0], [2.0, 0, 0]])
    points = {name: rig[name].project(ends).tolist() for name in rig.names[:2]}
    return {"metres": 4.0 * factor, "points": points, **more}


def between(rig, factor=1.0):
    first, second = rig.names[0], rig.names[2]
    metres = float(np.linalg.norm(rig[first].centre - rig[second].centre))
    return {"metres": metres * factor, "between": [first, second], "sd_m": 0.02}


@pytest.mark.slow
def test_a_check_changes_nothing_and_is_told(small):
    plain, checked = calibrated(small, []), calibrated(small, [marked(small.rig), between(small.rig)])
    for name in small.rig.names:
        assert np.array_equal(plain.rig[name].centre, checked.rig[name].centre)
    assert plain.figures.checks is None
    assert checked.verdict == plain.verdict == "accepted"
    first, second = checked.figures.checks
    assert (first.number, second.number) == (1, 2)
    for one in (first, second):
        assert abs(one.measured_m - one.stated_m) < 3 * one.sigma_m
        assert 0.01 < one.sigma_m / one.stated_m < 0.1
    told = checked.to_dict()["figures"]["checks"]
    assert told[1]["cameras"] == [small.rig.names[0], small.rig.names[2]]


@pytest.mark.parametrize("wrong", [marked, between])
def test_a_rig_that_contradicts_a_check_is_not_accepted(small, wrong):
    found = calibrated(small, [wrong(small.rig, 1.25)])
    assert found.verdict == "doubtful"
    (finding,) = [one for one in found.diagnostics if one.code == "check_length_off"]
    assert finding.values["number"] == 1


@pytest.mark.slow
def test_the_sigma_is_that_of_the_scale_where_nothing_is_measured(small):
    """A measured length makes a check sharper."""
    loose = calibrated(small, [between(small.rig)]).figures.checks[0]
    sharp = calibrated(small, [between(small.rig)], lengths=[marked(small.rig, sd_m=0.01)]).figures.checks[0]
    assert sharp.sigma_m < 0.6 * loose.sigma_m


@pytest.mark.parametrize(
    ("check", "fault"),
    [
        ({"metres": 1.0}, "has neither points nor between"),
        ({"metres": 1.0, "between": ["C1", "C1"]}, "names one camera twice"),
        ({"metres": 1.0, "between": ["C1", "Z"]}, r"\[\[scale.checks\]\] 1 between: camera"),
        ({"metres": 1.0, "points": {"C1": [[1, 2], [3, 4]]}}, "marked in one camera"),
        ({"metres": 1.0, "points": {"C1": [[-9, 2], [3, 4]], "C2": [[1, 2], [3, 4]]}}, r"checks\]\] 1 points: .* lies outside"),
    ],
)
def test_faults_name_their_place(small, check, fault):
    with pytest.raises(InputError, match=fault):
        calibrated(small, [check])


@pytest.mark.parametrize(("measured_m", "off"), [(3.75, False), (4.25, False), (3.65, True), (4.35, True)])
def test_a_check_is_off_by_its_difference_in_sigmas(measured_m, off):
    """Three sigmas are 0.3 m here, either way."""
    check = CheckedLength(number=3, cameras=("A", "B"), stated_m=4.0, measured_m=measured_m, sigma_m=0.1)
    found = findings_of_checks([check])
    assert [(one.code, one.severity, one.cameras) for one in found] == [("check_length_off", "doubt", ("A", "B"))] * off


def test_what_cannot_be_measured_is_a_notice_and_without_a_scale_nothing_is_judged(small):
    marks = ((1.0, 2.0), (3.0, 4.0))
    (lost,) = check_lengths([CheckTable(metres=1.0, points={"C1": marks, "gone": marks})], small.rig, 0.03)
    assert lost.measured_m is None
    assert [(one.code, one.severity) for one in findings_of_checks([lost])] == [("check_length_unmeasured", "notice")]
    (unsure,) = check_lengths([CheckTable(**between(small.rig, 2.0))], small.rig, None)
    assert unsure.sigma_m is None
    assert findings_of_checks([unsure]) == ()
