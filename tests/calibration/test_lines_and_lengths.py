"""Lines that are marked on straight things correct the vertical and set the heading; lengths check a rig and change nothing."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.alignment.lengths import check_lengths, findings_of_checks
from passerby.calibration.alignment.lines import MarkedLine, align_to_lines, measure_line
from passerby.calibration.alignment.places import CLICK_SD_PX, UNKNOWN_ORIENTATION_DEG
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Pose, PoseSigma, Rig
from passerby.core.figures import CheckedLength
from passerby.geometry.rotations import exp_rotation
from passerby.scene.scale_tables import CheckTable
from passerby.simulation import SimulationOptions, simulate


def marked_line(rig, direction, ends, names, noise=0.0, seed=0):
    """A line between two places of the world (2, 3), as these cameras see it."""
    rng = np.random.default_rng(seed)
    pixels = {name: rig[name].project(np.asarray(ends, float)) + noise * rng.normal(size=(2, 2)) for name in names}
    assert all(np.isfinite(values).all() for values in pixels.values())
    return MarkedLine(direction, {name: tuple(map(tuple, values.tolist())) for name, values in pixels.items()})


def tilted(rig, degrees, axis=(1.0, 0.5, 0.0)):
    turn = exp_rotation(np.radians(degrees) * np.array(axis) / np.linalg.norm(axis))
    return rig.moved(turn, np.zeros(3), 1.0)


def off_vertical(rig, truth):
    """Degrees between the verticals of two rigs."""
    turns = [rig[name].pose.R_cw.T @ truth[name].pose.R_cw for name in truth.names]
    return float(np.degrees(np.arccos(np.clip(np.mean(turns, axis=0)[2, 2], -1, 1))))


def middle(rig):
    return np.mean([camera.centre for camera in rig], axis=0) * [1, 1, 0]


ALONG = np.array([np.cos(0.7), np.sin(0.7), 0.0])


def heading_deg(found):
    """Of `ALONG` in the world that lines have set."""
    there = found.motion.rotation @ ALONG
    return np.degrees(np.arctan2(there[1], there[0]))


def posts(truth):
    return [np.array([[x, y, 0.0], [x, y, 2.2]]) + middle(truth) for x, y in ((1.0, 0.0), (-1.0, 1.5), (0.5, -1.5))]


@pytest.fixture(scope="module")
def truth():
    return simulate(SimulationOptions(seed=4000, seconds=2.0)).rig


def test_lines_set_a_vertical_that_people_left_open_and_people_count_beside_them(truth):
    """Door frames, and a horizontal line of two cameras; the ground stays amid the cameras."""
    wrong = tilted(truth, 2.0)
    found = align_to_lines(wrong, [marked_line(truth, "vertical", post, truth.names[:3]) for post in posts(truth)], 30.0)
    assert off_vertical(found.rig, truth) < 0.02
    assert found.figures["tilt_deg"] == pytest.approx(2.0, abs=0.02)
    assert not found.diagnostics
    moved = found.motion.rotation @ middle(wrong) + found.motion.translation
    assert moved[2] == pytest.approx(0.0, abs=1e-9)
    wrong = tilted(truth, 1.5)
    ends = [np.array([[-2.0, 0, 1.0], [2.0, 0, 1.0]]), np.array([[0, -2.0, 0.0], [0, 2.0, 0.0]])]
    lines = [marked_line(truth, "horizontal", one + middle(truth), truth.names) for one in ends]
    assert off_vertical(align_to_lines(wrong, lines, 5.0).rig, truth) < 0.05
    # A single line that is off by less than the people's sigma moves the vertical by a part of it.
    wrong = tilted(truth, 0.2)
    lines = [marked_line(truth, "vertical", posts(truth)[0], truth.names[:1])]
    sure, unsure = (off_vertical(align_to_lines(wrong, lines, sigma).rig, wrong) for sigma in (0.01, 1.0))
    assert sure < 0.05 < unsure


def test_the_error_is_as_large_as_it_is_stated(truth):
    """Forty hands that click with two pixels."""
    ratios = []
    for seed in range(40):
        lines = [
            marked_line(truth, "vertical", post, truth.names[:2], 2.0, 10 * seed + n) for n, post in enumerate(posts(truth))
        ]
        exact = replace(truth, cameras=tuple(replace(one, sigma=None) for one in tilted(truth, 1.0)))
        found = align_to_lines(exact, lines, 3.0)
        ratios.append(off_vertical(found.rig, truth) / found.figures["vertical_sigma_deg"])
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def test_a_wrong_line_is_named_and_left_out(truth):
    good = [marked_line(truth, "vertical", post, truth.names[:2]) for post in posts(truth)]
    leaning = marked_line(truth, "vertical", posts(truth)[0] + [[0, 0, 0], [0.8, 0.8, 0]], truth.names[:2])
    found = align_to_lines(truth, [*good, leaning], 0.3)
    assert {one.values["number"] for one in found.diagnostics} == {4}
    assert {one.code for one in found.diagnostics} == {"line_off"}
    assert off_vertical(found.rig, truth) < 0.1


@pytest.mark.parametrize("cameras", [1, 3])
@pytest.mark.parametrize("height", [0.0, 2.5])
def test_x_runs_along_a_line_at_any_height(truth, cameras, height):
    """Two lines of one heading are surer than one by the root of two."""
    ends = middle(truth) + np.array([-2.0 * ALONG, 2.0 * ALONG]) + [0, 0, height]
    line = marked_line(truth, "x", ends, truth.names[:cameras])
    one, two = (align_to_lines(truth, [line] * count, 0.01) for count in (1, 2))
    assert heading_deg(one) == pytest.approx(0.0, abs=0.05)
    assert one.figures["heading_sigma_deg"] == pytest.approx(np.sqrt(2) * two.figures["heading_sigma_deg"])
    assert two.figures["heading_sigma_deg"] > 0


def test_a_line_is_measured_before_it_is_saved_and_refused_without_cameras(truth):
    line = marked_line(truth, "vertical", posts(truth)[0], truth.names[:2])
    assert measure_line(truth, line).off_deg < 0.01
    told = measure_line(tilted(truth, 3.0), line)
    assert 0.5 < told.off_deg < 3.01
    assert told.sigma_deg > 0
    along_x = marked_line(truth, "x", posts(truth)[0] * [1, 1, 0] + [[0, 0, 0], [2, 0, 0]], truth.names[:1])
    assert measure_line(truth, along_x) is None
    line = marked_line(truth, "vertical", posts(truth)[0], truth.names[:1])
    lost = Rig(tuple(replace(one, pose=None) if one.name == truth.names[0] else one for one in truth))
    with pytest.raises(EvidenceError, match="no camera in which a line is marked has a pose"):
        align_to_lines(lost, [line], 0.3)
    with pytest.raises(InputError, match="no camera Z"):
        align_to_lines(truth, [MarkedLine("vertical", {"Z": ((1.0, 2.0), (3.0, 4.0))})], 0.3)


def test_the_angle_of_one_line_in_one_camera_scatters_as_it_is_stated(truth):
    """Clicks and the camera's own orientation are off by what they are taken to be off by."""
    rng, name = np.random.default_rng(5), truth.names[0]
    ratios = []
    for seed in range(60):
        turn = exp_rotation(np.radians(UNKNOWN_ORIENTATION_DEG) * rng.normal(size=3))
        pose = Pose.from_centre(turn @ truth[name].pose.R_cw, truth[name].centre)
        turned = Rig(tuple(replace(one, pose=pose if one.name == name else one.pose, sigma=None) for one in truth))
        told = measure_line(turned, marked_line(truth, "vertical", posts(truth)[0], [name], CLICK_SD_PX, seed), 0.0)
        ratios.append(told.off_deg / told.sigma_deg)
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.3


@pytest.mark.parametrize(("cameras", "times"), [(1, 100), (2, 40)])
def test_the_heading_along_a_line_scatters_as_it_is_stated(truth, cameras, times):
    """By clicks alone: the cameras' orientations are known."""
    known = Rig(tuple(replace(one, sigma=PoseSigma(1e-6, 1e-6)) for one in truth))
    ends = middle(truth) + np.array([-2.0 * ALONG, 2.0 * ALONG])
    ratios = []
    for seed in range(times):
        found = align_to_lines(known, [marked_line(truth, "x", ends, truth.names[:cameras], CLICK_SD_PX, seed)], 1e-5)
        ratios.append(heading_deg(found) / found.figures["heading_sigma_deg"])
    assert 0.75 < np.sqrt(np.mean(np.square(ratios))) < 1.35


@pytest.fixture(scope="module")
def small():
    return simulate(SimulationOptions(seed=4000, seconds=12.0, box_noise=0.02))


def calibrated(simulated, checks, **scale):
    boxes = {
        name: seen.boxes.take(np.flatnonzero(seen.boxes.identity > 0)) for name, seen in simulated.observations.cameras.items()
    }
    association = {"mode": "given", "max_offset_s": 0}
    return calibrate_observations(simulated.rig, boxes, fps=5, association=association, scale={"checks": checks, **scale})


def marked_length(rig, factor=1.0, **more):
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
def test_a_check_changes_nothing_and_is_reported(small):
    """Its sigma is that of the scale where nothing is measured; a measured length makes it sharper."""
    plain, checked = calibrated(small, []), calibrated(small, [marked_length(small.rig), between(small.rig)])
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
    sharp = calibrated(small, [between(small.rig)], lengths=[marked_length(small.rig, sd_m=0.01)]).figures.checks[0]
    assert sharp.sigma_m < 0.6 * second.sigma_m


@pytest.mark.parametrize("wrong", [marked_length, between])
def test_a_rig_that_contradicts_a_check_is_not_accepted(small, wrong):
    found = calibrated(small, [wrong(small.rig, 1.25)])
    assert found.verdict == "doubtful"
    (finding,) = [one for one in found.diagnostics if one.code == "check_length_off"]
    assert finding.values["number"] == 1


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


def test_what_cannot_be_measured_is_a_notice_and_without_a_scale_no_check_counts(small):
    marks = ((1.0, 2.0), (3.0, 4.0))
    (lost,) = check_lengths([CheckTable(metres=1.0, points={"C1": marks, "gone": marks})], small.rig, 0.03)
    assert lost.measured_m is None
    assert [(one.code, one.severity) for one in findings_of_checks([lost])] == [("check_length_unmeasured", "notice")]
    (unsure,) = check_lengths([CheckTable(**between(small.rig, 2.0))], small.rig, None)
    assert unsure.sigma_m is None
    assert findings_of_checks([unsure]) == ()
