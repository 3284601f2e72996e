"""What the command line shows of a calibration, and of the way to it."""

import json
import time
from dataclasses import replace
from unittest.mock import Mock, call

import numpy as np
import pytest

from passerby.association.result import Association
from passerby.calibration.calibration import Calibration
from passerby.cli.tables import show_calibration
from passerby.cli.terminal import StageTimes, _Events, _Log, stages
from passerby.common.progress import ProgressForm, tell_failure, tell_note, tell_warning
from passerby.core.association_figures import AssociationFigures, TiedPair
from passerby.core.cameras import Lens, Pose, PoseSigma, Rig
from passerby.core.figures import AdjustedFigures, CueFigures, ScaleFigures, SolvedCamera
from passerby.core.lens_figures import DistortionFigures, FocalFigures, LensFigures, PrincipalPointFigures, field_of_view_deg
from passerby.core.observations import Clock
from passerby.findings.finding import doubt, notice
from passerby.findings.texts import text_of
from passerby.scene.inputs import read_inputs
from passerby.scene.scene import Scene
from support.scenes.handmade_files import write_scene

pytestmark = pytest.mark.unit

PAIR = TiedPair(
    cameras=("A", "B"), route="tracks", used=True, score=91.25, share=0.885, runner_up=0.0, support=None, matches=120,
    matched_tracklets=3, offset_s=-1.4, registered_offset_s=-1.4, looks=None,
)  # fmt: skip


LOOKS = replace(PAIR, score=None, share=None, runner_up=None, matches=None, registered_offset_s=None, route="looks")
SEARCHED = 'mode = "given"\nmax_offset_s = 3'


@pytest.fixture
def calibration(tmp_path):
    """Two cameras, their clocks searched for; the second is not registered where `lost`."""

    def made(association=SEARCHED, lost=False):
        scene = Scene.load(write_scene(tmp_path, extra="[scene]\nfps = 7", association=association))
        inputs = read_inputs(scene)
        pose, sigma = Pose(np.eye(3), np.array([0, 0, 2.0])), PoseSigma(0.01, 0.2)
        cameras = [camera if lost and camera.name == "B" else replace(camera, pose=pose, sigma=sigma) for camera in inputs.rig]
        clocks, seen = {"A": Clock(7.0), "B": Clock(7.0, -1.4142)}, inputs.observations
        association = Association(seen, seen, clocks, {"A": 0.0, "B": 0.0123}, AssociationFigures(pairs=(PAIR, LOOKS)))
        figures = AdjustedFigures(foot_shift=0.5)
        return Calibration(scene, Rig(tuple(cameras)), "accepted", (), seen, 0, {}, figures, association, {"solving": 1.0})

    return made


def shown(capsys, calibration, verbose=False):
    show_calibration(calibration, verbose=verbose)
    return capsys.readouterr().out


def test_clocks_are_shown_where_they_were_searched_for_and_a_camera_has_a_pose(calibration, capsys):
    head, first, second = shown(capsys, calibration()).splitlines()[1:4]
    assert "time offset s offset std s" in " ".join(head.split())
    assert (first.split()[8:10], second.split()[8:10]) == (["0.000", "0.000"], ["-1.414", "0.012"])
    assert shown(capsys, calibration(lost=True)).splitlines()[3].split()[1:10] == ["-"] * 9
    assert "offset" not in shown(capsys, calibration('mode = "given"'))


def test_pairs_and_reasons_are_shown_on_request(calibration, capsys):
    assert "second-best" not in shown(capsys, calibration())
    table = [" ".join(line.split()) for line in shown(capsys, calibration(), verbose=True).splitlines()]
    start = table.index("pairs of cameras")
    assert table[start + 1 : start + 4] == [
        "pair route score share second-best matches offset s used",
        "A + B tracks 91.2 0.89 0.00 120 -1.40 yes",
        "A + B appearance - - - - - yes",
    ]
    found = calibration(lost=True)
    why, lost = notice("nobody_seen_whole", "B"), doubt("camera_without_pose", "B", why=None)
    association = replace(found.association, lost={"B": why})
    found = replace(found, association=association, verdict="doubtful", diagnostics=(lost,))
    assert text_of(why) not in shown(capsys, found)
    assert {f"B: {text_of(why)}", f"doubtful: {text_of(lost)}"} <= set(shown(capsys, found, verbose=True).splitlines())


def test_the_scale_is_shown_with_its_cues_and_what_a_measured_length_would_mend(calibration, capsys):
    usual = {"stated_m": 1.7, "measured_m": 1.7, "sd_m": 0.1, "residual_sigmas": 0.0}
    crowd = CueFigures(cue="population of 3", kind="population", count=3, share=0.9, **usual)
    scale = ScaleFigures(relative_sigma=0.047, cues=(crowd, CueFigures(cue="height of A", share=0.1, **usual)))
    for within_mm, mends in ((2.0, True), (8.0, False)):
        cameras = tuple(SolvedCamera(name=name, shape_position_sigma_mm=mm) for name, mm in (("A", 1.0), ("B", within_mm)))
        said = shown(capsys, replace(calibration(), figures=AdjustedFigures(scale=scale, cameras=cameras)))
        assert "scale known to 4.7 %, from heights of 3 people (90 %), height of A (10 %)" in said
        assert ("relative positions are known to 2 mm" in said) is mends


def test_the_scale_by_each_cue_is_shown_on_request(calibration, capsys):
    first = CueFigures(
        cue="length 1", kind="length", stated_m=3.6, measured_m=3.5, sd_m=0.02, residual_sigmas=-5.0, share=0.9,
        own_scale=1.031, own_sigma=0.008, disagrees_with=("height of camera A",),
    )  # fmt: skip
    second = replace(first, cue="height of camera A", kind="camera_height", own_scale=None, own_sigma=None, disagrees_with=())
    cameras = (SolvedCamera(name="A", shape_position_sigma_mm=1.0),)

    def rows(cues, verbose):
        figures = AdjustedFigures(scale=ScaleFigures(relative_sigma=0.01, cues=cues), cameras=cameras)
        said = shown(capsys, replace(calibration(), figures=figures), verbose)
        return [row for line in said.splitlines() if (row := " ".join(line.split())).startswith("length 1 ")]

    assert rows((first, second), True) == ["length 1 3.600 3.500 +3.1 0.8 90 height of camera A"]
    assert rows((first, second), False) == rows((first,), True) == []


def test_lenses_that_were_estimated_are_shown(calibration, capsys):
    found, states = calibration(), {"far": False, "people_share": 1.0}
    focal = FocalFigures(
        stated_px=400.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, told=True, prior="search", **states
    )
    point = PrincipalPointFigures(
        stated_px=(320.0, 240.0), refined_px=(321.0, 238.0), sigma_px=(6.0, 7.0), people_sigma_px=(50.0, 60.0), far=False,
        told=False, prior_sigma_px=(6.4, 6.4), prior="assumed", people_share=(0.02, 0.01),
    )  # fmt: skip
    bent = DistortionFigures(refined=-0.12, sigma=0.03, stated=0.0, prior_sigma=0.15, people_sigma=0.031, people_share=0.95)
    lens = Lens((640, 480), np.array([[500.0, 0, 321], [0, 500, 238], [0, 0, 1]]), np.array([-0.12, 0, 0, 0]))
    rig = Rig(tuple(replace(camera, lens=lens) if camera.name == "B" else camera for camera in found.rig))
    figures = AdjustedFigures(lenses={"B": LensFigures(focal=focal, principal_point=point, distortion=bent)})
    said = shown(capsys, replace(found, rig=rig, figures=figures)).splitlines()
    across, down = field_of_view_deg(lens)
    expected = f"B 500.0 2.0 {across:.0f} x {down:.0f} 321 238 7.0 -0.120 0.030 principal point"
    assert said[said.index("intrinsics estimated from people") + 2].split() == expected.split()
    assert "intrinsics estimated" not in shown(capsys, found)


def test_stages_are_lines_on_request_and_a_bar_on_a_terminal(monkeypatch, capsys):
    for verbose, told in ((False, ""), (True, "reading\npairs of cameras: 21\n")):
        with stages(verbose) as tell:
            tell("reading")
            for done in range(22):
                tell("pairs of cameras", done, 21)
        assert capsys.readouterr().err == told
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    with stages() as tell:
        for done in (0, 5):
            tell("pairs of cameras", done, 21)
        tell("solving")
    shown = capsys.readouterr().err
    assert "•" in shown
    assert "0 of 21" in shown


def test_a_long_run_logs_how_far_it_is_and_how_long_is_left(monkeypatch, capsys):
    monkeypatch.setattr(time, "time", lambda: pytest.fail("the clock of the day, which jumps"))
    now = [0.0]
    log = _Log(lambda: now[0])
    log("reading")
    # Twenty-nine seconds of preparation, which say nothing of the pace.
    for second in range(150):
        now[0] = second
        for camera in ("C1", "C2"):
            log("watching", max(0, second - 29), 120, part=camera)
    log("solving")
    now[0] = 200.0
    log("solving")
    assert capsys.readouterr().err.splitlines() == [
        "watching: 1 of 240 (0 %)",
        "watching: 61 of 240 (25 %), about 90 s left",
        "watching: 121 of 240 (50 %), about 60 s left",
        "watching: 181 of 240 (75 %), about 30 s left",
        "solving",
    ]
    slow = iter([0.0, 31.0, 62.0])
    log = _Log(lambda: next(slow))
    for done in (10, 20):
        log("watching", done, 100)
    assert capsys.readouterr().err.splitlines()[-1] == "watching: 20 of 100 (20 %), about 4 min left"


def test_a_program_reads_how_far_a_run_is(capsys):
    now = [0.0]
    tell = _Events(lambda: now[0])
    tell("reading")
    for done, second in ((0, 0.0), (1, 0.1), (2, 0.3), (1, 1.0), (3, 1.1), (5, 1.1), (5, 1.2)):
        now[0] = second
        tell("watching", done, 5, part="Nord\u00fc")
    tell_note(tell, "camera C1\nsaw nobody")
    tell_warning(tell, "no network")
    tell_failure(tell, "watching")
    tell("solving")
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [event.pop("event") for event in events] == [
        "begin", "end", "begin", *["progress"] * 4, "note", "warning", "failed", "begin",
    ]  # fmt: skip
    assert [event["done"] for event in events if "done" in event] == [0, 2, 3, 5]
    assert events[4] == {"stage": "watching", "part": "Nord\u00fc", "done": 2, "total": 5, "seconds": 0.3}
    assert [event["text"] for event in events if "text" in event] == ["camera C1 saw nobody", "no network"]
    # Only a stage that is done ends.
    with pytest.raises(KeyboardInterrupt), stages(form=ProgressForm.json) as tell:  # noqa: PT012
        tell("reading")
        tell("solving")
        raise KeyboardInterrupt
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    told = [(event["event"], event["stage"]) for event in events]
    assert told == [("begin", "reading"), ("end", "reading"), ("begin", "solving")]


def test_the_wall_time_is_the_sum_of_the_stages(capsys):
    now, listener = [10.0], Mock()
    tell = StageTimes(listener, 7.0, lambda: now[0])
    for at, stage in ((10.0, "reading"), (12.0, "solving"), (13.0, "solving"), (16.0, "reading"), (17.5, "writing")):
        now[0] = at
        tell(stage, 1, 2, part="C1")
    tell.note("odd")
    told = ("reading", "solving", "solving", "reading", "writing")
    assert listener.mock_calls == [*(call(stage, 1, 2, part="C1") for stage in told), call.note("odd")]
    now[0] = 20.0
    tell.show()
    rows = (line.split()[:2] for line in capsys.readouterr().out.splitlines()[2:])
    assert dict(rows) == {"start": "3.0", "reading": "3.5", "solving": "4.0", "writing": "2.5", "total": "13.0"}
