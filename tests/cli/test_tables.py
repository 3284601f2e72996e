"""What the command line shows of a calibration, and of the way to it."""

import json
from dataclasses import replace

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


@pytest.fixture
def calibration(tmp_path):
    """Two cameras, their clocks searched for; the second is not registered where `lost`."""

    def made(association, lost=False):
        scene = Scene.load(write_scene(tmp_path, extra="[scene]\nfps = 7", association=association))
        inputs = read_inputs(scene)
        pose, sigma = Pose(np.eye(3), np.array([0, 0, 2.0])), PoseSigma(0.01, 0.2)
        cameras = [camera if lost and camera.name == "B" else replace(camera, pose=pose, sigma=sigma) for camera in inputs.rig]
        clocks = {"A": Clock(7.0), "B": Clock(7.0, -1.4142)}
        association = Association(
            inputs.observations, inputs.observations, clocks, {"A": 0.0, "B": 0.0123}, AssociationFigures(pairs=(PAIR, LOOKS))
        )
        return Calibration(
            scene,
            Rig(tuple(cameras)),
            "accepted",
            (),
            inputs.observations,
            0,
            {},
            AdjustedFigures(foot_shift=0.5),
            association,
            {"solving": 1.0},
        )

    return made


LOOKS = replace(PAIR, score=None, share=None, runner_up=None, matches=None, registered_offset_s=None, route="looks")
SEARCHED = 'mode = "given"\nmax_offset_s = 3'


def lines(capsys):
    return [line.split() for line in capsys.readouterr().out.splitlines()]


def test_clocks_that_were_searched_for_are_shown(calibration, capsys):
    show_calibration(calibration(SEARCHED), verbose=False)
    _, head, first, second, *_ = lines(capsys)
    assert (
        " ".join(head) == "camera x m y m height m points std mm ground std mm position std mm rotation std deg time offset s "
        "offset std s boxes keypoints"
    )
    assert first[8:10] == ["0.000", "0.000"]
    assert second[8:10] == ["-1.414", "0.012"]


def test_a_camera_without_a_pose_has_no_clock(calibration, capsys):
    show_calibration(calibration(SEARCHED, lost=True), verbose=False)
    assert lines(capsys)[3][1:10] == ["-"] * 9


def test_clocks_that_agree_are_not_shown(calibration, capsys):
    show_calibration(calibration('mode = "given"'), verbose=False)
    assert "clock" not in capsys.readouterr().out


def test_pairs_are_for_those_who_want_to_know_more(calibration, capsys):
    show_calibration(calibration(SEARCHED), verbose=False)
    assert "second-best" not in capsys.readouterr().out
    show_calibration(calibration(SEARCHED), verbose=True)
    table = lines(capsys)
    start = table.index(["pairs", "of", "cameras"])
    assert table[start + 1] == ["pair", "route", "score", "share", "second-best", "matches", "offset", "s", "used"]
    assert table[start + 2] == ["A", "+", "B", "tracks", "91.2", "0.89", "0.00", "120", "-1.40", "yes"]
    assert table[start + 3] == ["A", "+", "B", "appearance", "-", "-", "-", "-", "-", "yes"]


def test_reasons_are_for_those_who_want_to_know_more(calibration, capsys):
    found = calibration(SEARCHED, lost=True)
    why, lost = notice("nobody_seen_whole", "B"), doubt("camera_without_pose", "B", why=None)
    association = replace(found.association, lost={"B": why})
    found = replace(found, association=association, verdict="doubtful", diagnostics=(lost,))
    show_calibration(found, verbose=False)
    assert "head to feet" not in capsys.readouterr().out
    show_calibration(found, verbose=True)
    shown = capsys.readouterr().out.splitlines()
    assert f"B: {text_of(why)}" in shown
    assert f"doubtful: {text_of(lost)}" in shown


def test_what_a_measured_length_would_mend(calibration, capsys):
    found = calibration(SEARCHED)
    cues = (
        CueFigures(
            cue="population of 3", kind="population", count=3, stated_m=1.7, measured_m=1.7, sd_m=0.1, residual_sigmas=0.0,
            share=0.9,
        ),
        CueFigures(cue="height of A", stated_m=1.7, measured_m=1.7, sd_m=0.1, residual_sigmas=0.0, share=0.1),
    )  # fmt: skip
    scale = ScaleFigures(relative_sigma=0.047, cues=cues)
    for within, told in ((2.0, True), (8.0, False)):
        sigmas = {"A": 1.0, "B": within}
        cameras = tuple(SolvedCamera(name=name, shape_position_sigma_mm=sigma) for name, sigma in sigmas.items())
        show_calibration(replace(found, figures=AdjustedFigures(scale=scale, cameras=cameras)), verbose=False)
        shown = capsys.readouterr().out
        assert "scale known to 4.7 %, from heights of 3 people (90 %), height of A (10 %)" in shown
        assert ("relative positions are known to 2 mm" in shown) is told


def test_each_cue_says_its_own_scale_to_those_who_want_to_know_more(calibration, capsys):
    first = CueFigures(
        cue="length 1", kind="length", stated_m=3.6, measured_m=3.5, sd_m=0.02, residual_sigmas=-5.0, share=0.9,
        own_scale=1.031, own_sigma=0.008, disagrees_with=("height of camera A",),
    )  # fmt: skip
    second = CueFigures(
        cue="height of camera A", kind="camera_height", stated_m=2.0, measured_m=2.0, sd_m=0.05, residual_sigmas=0.0, share=0.1
    )
    cameras = (SolvedCamera(name="A", shape_position_sigma_mm=1.0),)

    def shown(cues, verbose):
        figures = AdjustedFigures(scale=ScaleFigures(relative_sigma=0.01, cues=cues), cameras=cameras)
        show_calibration(replace(calibration(SEARCHED), figures=figures), verbose=verbose)
        return lines(capsys)

    assert [row for row in shown((first, second), True) if row[:2] == ["length", "1"]] == [
        ["length", "1", "3.600", "3.500", "+3.1", "0.8", "90", "height", "of", "camera", "A"]
    ]
    assert not [row for row in shown((first, second), False) if row[:2] == ["length", "1"]]
    assert not [row for row in shown((first,), True) if row[:2] == ["length", "1"]]


def test_lenses_that_were_estimated_are_shown(calibration, capsys):
    found = calibration(SEARCHED)
    focal = FocalFigures(
        stated_px=400.0, refined_px=500.0, sigma_px=10.0, people_sigma_px=12.0, far=False, told=True, prior="search",
        people_share=1.0,
    )  # fmt: skip
    point = PrincipalPointFigures(
        stated_px=(320.0, 240.0), refined_px=(321.0, 238.0), sigma_px=(6.0, 7.0), people_sigma_px=(50.0, 60.0), far=False,
        told=False, prior_sigma_px=(6.4, 6.4), prior="assumed", people_share=(0.02, 0.01),
    )  # fmt: skip
    bent = DistortionFigures(refined=-0.12, sigma=0.03, stated=0.0, prior_sigma=0.15, people_sigma=0.031, people_share=0.95)
    lens = Lens((640, 480), np.array([[500.0, 0, 321], [0, 500, 238], [0, 0, 1]]), np.array([-0.12, 0, 0, 0]))
    rig = Rig(tuple(replace(camera, lens=lens) if camera.name == "B" else camera for camera in found.rig))
    figures = AdjustedFigures(lenses={"B": LensFigures(focal=focal, principal_point=point, distortion=bent)})
    show_calibration(replace(found, rig=rig, figures=figures), verbose=False)
    shown = capsys.readouterr().out.splitlines()
    row = shown[shown.index("intrinsics estimated from people") + 2].split()
    across, down = field_of_view_deg(lens)
    numbers = ["500.0", "2.0", f"{across:.0f}", "x", f"{down:.0f}", "321", "238", "7.0", "-0.120", "0.030"]
    assert row == ["B", *numbers, "principal", "point"]
    show_calibration(found, verbose=False)
    assert "intrinsics estimated" not in capsys.readouterr().out


def test_stages_are_lines_for_those_who_want_them_where_there_is_no_terminal(capsys):
    for verbose, told in ((False, ""), (True, "reading\npairs of cameras: 21\n")):
        with stages(verbose) as tell:
            tell("reading")
            for done in range(22):
                tell("pairs of cameras", done, 21)
        assert capsys.readouterr().err == told


def test_stages_are_a_bar_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "100")
    with stages() as tell:
        tell("reading [odd name]")
        tell("pairs of cameras", 0, 21)
        tell("pairs of cameras", 5, 21)
        tell_note(tell, "camera [C1] saw nobody")
        tell("solving")
    shown = capsys.readouterr().err
    assert "reading [odd name]" in shown
    assert "camera [C1] saw nobody" in shown
    assert "•" in shown
    assert "0 of 21" in shown


def test_a_long_run_tells_now_and_then_how_far_it_is_where_there_is_no_terminal(capsys):
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
    told = capsys.readouterr().err.splitlines()
    assert told == [
        "watching: 1 of 240 (0 %)",
        "watching: 61 of 240 (25 %), about 90 s left",
        "watching: 121 of 240 (50 %), about 60 s left",
        "watching: 181 of 240 (75 %), about 30 s left",
        "solving",
    ]


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


def test_only_a_stage_that_is_done_ends(capsys):
    def interrupted():
        with stages(form=ProgressForm.json) as tell:
            tell("reading")
            tell("solving")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    events = [json.loads(line) for line in capsys.readouterr().err.splitlines()]
    assert [(event["event"], event["stage"]) for event in events] == [
        ("begin", "reading"), ("end", "reading"), ("begin", "solving"),
    ]  # fmt: skip


def test_a_listener_without_notes_is_told_none():
    tell_note(lambda stage, done=0, total=0, *, part="": None, "nothing happens")


def test_the_wall_time_is_the_sum_of_the_stages(capsys):
    now, heard = [10.0], []

    class Listener:
        def __call__(self, stage, done=0, total=0, *, part=""):
            heard.append((stage, done, total, part))

        def note(self, text):
            heard.append(text)

    tell = StageTimes(Listener(), 7.0, lambda: now[0])
    for at, stage in ((10.0, "reading"), (12.0, "solving"), (13.0, "solving"), (16.0, "reading"), (17.5, "writing")):
        now[0] = at
        tell(stage, 1, 2, part="C1")
    tell.note("odd")
    assert heard == [*((stage, 1, 2, "C1") for stage in ("reading", "solving", "solving", "reading", "writing")), "odd"]
    now[0] = 20.0
    tell.show()
    shown = {row[0]: row[1] for row in lines(capsys)[2:]}
    assert shown == {"start": "3.0", "reading": "3.5", "solving": "4.0", "writing": "2.5", "total": "13.0"}
