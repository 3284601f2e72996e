"""Groups of cameras that share nobody: each a rig of its own, in files of its own; and which pairs of cameras are compared."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

import passerby
import passerby.calibration.calibrate as calibrate_module
from passerby.association.doors import Door
from passerby.association.ground.pair_matching import GroundMotion
from passerby.association.ground.passages import Passage
from passerby.association.result import Association
from passerby.calibration.alignment.folder import write_aligned
from passerby.calibration.alignment.world import align_to_camera
from passerby.calibration.association_run import AssociationOptions
from passerby.calibration.association_start import _find_candidates
from passerby.calibration.calibrate import calibrate
from passerby.calibration.calibration import Calibration
from passerby.calibration.lens_corrections import LensExamination
from passerby.calibration.run import CalibrationRun, Corrections, Estimate
from passerby.calibration.separate_groups import GroupEstimate, join_groups, stated_parts
from passerby.calibration.writing import write_calibration
from passerby.cli.tables import show_calibration, tell_reasons
from passerby.common.progress import silent
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.core.observations import Boxes
from passerby.core.solution import Solution
from passerby.core.usability import doubt_missing_pose
from passerby.evaluation.metrics import compare
from passerby.findings.finding import notice
from passerby.findings.texts import text_of
from passerby.interchange.output_folder import read_output
from passerby.interchange.rig_toml import read_rig
from passerby.report.contents import contents_from
from passerby.scene.inputs import SceneInputs
from passerby.scene.scene import Scene
from passerby.simulation import SimulatedScene, SimulationOptions, simulate
from passerby.simulation.sites.site import SiteOptions, simulate_site, write_site
from passerby.solver.people import PeopleOptions

ANOTHER_FLOOR = 1000
"""Added to the identities of the people of the second room."""


def room(seed: int, cameras: int) -> SimulatedScene:
    return simulate(SimulationOptions(seed=seed, seconds=15.0, cameras=cameras, box_noise=0.01))


@pytest.fixture(scope="module")
def rooms() -> tuple[Rig, dict[str, Boxes]]:
    """The true rig and the boxes of a room with three cameras and of one with two (U1, U2) that nobody walks between."""
    lower, upper = room(840, 3), room(841, 2)
    named = {camera.name: f"U{number}" for number, camera in enumerate(upper.rig, start=1)}
    boxes = {name: seen.boxes for name, seen in lower.observations.cameras.items()}
    boxes |= {
        named[name]: replace(seen.boxes, identity=seen.boxes.identity + ANOTHER_FLOOR)
        for name, seen in upper.observations.cameras.items()
    }
    cameras = (*lower.rig, *(replace(camera, name=named[camera.name]) for camera in upper.rig))
    return Rig(cameras), boxes


@pytest.fixture(scope="module")
def found(rooms: tuple[Rig, dict[str, Boxes]]) -> Calibration:
    truth, boxes = rooms
    return passerby.calibrate_observations(truth, boxes, fps=5.0, association={"mode": "given", "max_offset_s": 0})


def test_each_group_is_a_rig_of_its_own(rooms, found):
    truth, _ = rooms
    assert found.rig.posed().names == ("C1", "C2", "C3")
    assert found.rig.names == truth.names
    (upper,) = found.groups
    assert upper.group == 2
    assert upper.rig.names == upper.rig.posed().names == ("U1", "U2")
    for one in (found, upper):
        assert max(compare(one.rig.posed(), truth).similarity.orientation_deg.values()) < 1.5
    assert [one.code for one in found.notices] == ["separate_group"]
    assert found.verdict == "doubtful"
    assert [one.values["why"]["code"] for one in found.doubts if one.code == "camera_without_pose"] == ["cameras_share_nobody"]


def test_cameras_of_other_groups_are_one_reason_however_they_were_apart_before(found):
    """U1 and U2 shared nobody with each other either, and were joined since; C3 is in no group, and is told by itself."""
    apart = [notice("cameras_share_nobody", name, main=["C1", "C2"], given=False) for name in ("U1", "C3", "U2")]
    before = tuple(doubt_missing_pose(one) for one in apart)
    rig = replace(found.rig, cameras=tuple(replace(one, pose=None) if one.name == "C3" else one for one in found.rig))
    main = replace(found, rig=rig, groups=(), diagnostics=(*before, notice("groups_unused")))
    estimate = cast(GroupEstimate, SimpleNamespace(nearest=None))
    joined = join_groups([(estimate, main), (estimate, found.groups[0])], silent)
    whole, alone, kept, separate = joined.diagnostics
    assert (whole.cameras, alone.cameras) == (("U1", "U2"), ("C3",))
    assert whole.values["why"]["values"] == {"main": ["C1", "C2"], "given": False, "groups": 1}
    assert text_of(whole).startswith("cameras U1, U2 share no people with C1, C2 and form a separate group: ")
    assert (alone, kept.code, separate.code) == (before[1], "groups_unused", "separate_group")
    assert join_groups([(estimate, found), (estimate, found.groups[0])], silent).doubts == found.doubts


@pytest.mark.slow
def test_a_group_is_what_its_cameras_alone_would_be(rooms, found):
    truth, boxes = rooms
    alone = Rig(tuple(camera for camera in truth if camera.name.startswith("U")))
    own = {name: seen for name, seen in boxes.items() if name in alone.names}
    again = passerby.calibrate_observations(alone, own, fps=5.0, association={"mode": "given", "max_offset_s": 0})
    assert not again.groups
    for camera in again.rig:
        np.testing.assert_array_equal(camera.centre, found.groups[0].rig[camera.name].centre)


def test_files_of_groups_are_an_output_folder_each_and_go_with_them(rooms, found, tmp_path):
    out = tmp_path / "out"
    write_calibration(found, out, report=True)
    written = json.loads((out / "calibration.json").read_text())
    assert written["groups"] == [
        {"group": 2, "folder": "groups/2", "verdict": found.groups[0].verdict, "registered": 2, "cameras": ["U1", "U2"]}
    ]
    upper = read_output(out / "groups/2")
    assert upper.rig.names == ("U1", "U2")
    assert (upper.document.group, read_output(out).document.group) == (2, None)
    assert len(upper.boxes["U1"]) > 100
    assert 'href="groups/2/report.html"' in (out / "report.html").read_text(encoding="utf-8")
    assert (out / "groups/2/report.html").is_file()
    assert contents_from(out / "groups/2").document.name == f"{found.scene.name}, group 2"
    (out / "groups/2/notes.txt").write_text("mine")
    write_calibration(replace(found, groups=()), out, report=False)
    assert [path.name for path in (out / "groups").rglob("*") if path.is_file()] == ["notes.txt"]
    (out / "groups/2/notes.txt").unlink()
    write_calibration(found, out, report=False)
    write_calibration(replace(found, groups=()), out, report=False)
    assert not (out / "groups").exists()
    assert "groups" not in json.loads((out / "calibration.json").read_text())


@pytest.mark.slow
def test_known_positions_place_all_groups_in_one_frame(rooms, tmp_path):
    truth, boxes = rooms
    rows = [f"{camera.name},{','.join(f'{value:.3f}' for value in camera.centre)},0.05" for camera in truth]
    (tmp_path / "positions.csv").write_text("\n".join(["camera,x,y,z,sd_m", *rows]) + "\n")
    tables = {"association": {"mode": "given", "max_offset_s": 0}, "world": {"positions": tmp_path / "positions.csv"}}
    found = passerby.calibrate_observations(truth, boxes, fps=5.0, **tables)
    for one in (found, *found.groups):
        for camera in one.rig.posed():
            assert np.linalg.norm(camera.centre - truth[camera.name].centre) < 0.3
    assert "position_without_pose" not in {one.code for one in found.groups[0].notices}


def test_another_frame_is_that_of_one_group_only(found, tmp_path):
    out = tmp_path / "out"
    write_calibration(found, out, report=False)
    aligned = align_to_camera(found.rig, "C2")
    assert any("groups/2" in told for told in write_aligned(out, tmp_path / "new", aligned))
    assert "groups" not in json.loads((tmp_path / "new/calibration.json").read_text())
    before = (out / "groups/2/rig.toml").read_bytes()
    assert any("groups/2" in told for told in write_aligned(out, out, aligned))
    assert json.loads((out / "calibration.json").read_text())["groups"][0]["folder"] == "groups/2"
    assert (out / "groups/2/rig.toml").read_bytes() == before


def test_all_groups_are_shown_and_decide_the_exit_status(found, capsys):
    show_calibration(found, verbose=False)
    tell_reasons(replace(found, groups=(replace(found.groups[0], verdict="doubtful"),)))
    told = capsys.readouterr()
    assert ", group 2: " in told.out
    assert "U2" in told.out.split(", group 2: ")[1]
    assert "group 2: doubtful: " in told.err
    main = replace(found, verdict="accepted")
    for verdict, status in (("accepted", 0), ("doubtful", 3)):
        assert replace(main, groups=(replace(found.groups[0], verdict=verdict),)).exit_status == status


@pytest.mark.slow
def test_stated_groups_do_not_doubt_each_other():
    lower, upper = room(842, 3), room(843, 2)
    boxes = {f"L{name}": seen.boxes for name, seen in lower.observations.cameras.items()}
    boxes |= {f"U{name}": seen.boxes for name, seen in upper.observations.cameras.items()}
    lenses = {f"L{camera.name}": camera.lens for camera in lower.rig} | {f"U{camera.name}": camera.lens for camera in upper.rig}
    groups = [[name for name in lenses if name[0] == floor] for floor in "LU"]
    tables = {"sites": {"groups": groups}, "association": {"max_offset_s": 0}}
    found = passerby.calibrate_observations(lenses, boxes, fps=5.0, **tables)
    assert found.rig.names == tuple(groups[0])
    assert [one.rig.names for one in found.groups] == [tuple(groups[1])]
    assert "camera_without_pose" not in {one.code for one in found.diagnostics}


def hall_and_corridor(seed: int, folder: Path) -> Calibration:
    """A corridor of four cameras and a hall of four, behind a door two metres wide; five minutes of tracklets."""
    options = SiteOptions(cameras=8, seed=seed, seconds=300.0, box_noise=0.02, missing=0.1, tracklet_seconds=20.0)
    return calibrate(write_site(simulate_site(options), folder / "site"))


@pytest.mark.slow
def test_a_hall_and_a_corridor_are_one_rig_where_people_pass_the_door(tmp_path):
    found = hall_and_corridor(11, tmp_path)
    assert found.verdict == "accepted"
    assert not found.groups
    (joint,) = (one for one in found.notices if one.code == "groups_joined")
    assert joint.values["people"] > 25
    assert joint.values["sizes"] == [4, 4]
    truth = read_rig(tmp_path / "site" / "truth.toml")
    errors = compare(found.rig, truth)
    assert errors.similarity.mean_position_mm < 350
    assert errors.similarity.mean_orientation_deg < 1.0
    for names in (truth.names[:4], truth.names[4:]):  # each side is as good as by itself
        side = Rig(tuple(found.rig[name] for name in names))
        assert compare(side, truth).similarity.mean_position_mm < 80


@pytest.mark.slow
def test_groups_that_see_too_few_people_at_one_time_stay_as_they_are(tmp_path):
    found = hall_and_corridor(804, tmp_path)
    (hall,) = found.groups
    assert hall.accepted
    (told,) = (one for one in found.notices if one.code == "separate_group")
    assert told.values["people"] >= told.values["needed"]
    assert "both groups see too few of them at one time" in " ".join(found.findings)


@pytest.mark.parametrize(
    ("stated", "parts"),
    [
        ((), [["a", "b", "c", "d"]]),
        ((("a", "b"), ("c", "d")), [["a", "b"], ["c", "d"]]),
        ((("c", "d"), ("b", "d"), ("a", "c")), [["a", "b", "c", "d"]]),
        ((("d", "b"), ("a", "c")), [["a", "c"], ["b", "d"]]),
    ],
)
def test_stated_groups_with_a_common_camera_are_one_part(stated, parts):
    assert stated_parts(["a", "b", "c", "d"], stated) == parts


def group_of(names: tuple[str, ...]) -> GroupEstimate:
    """An estimate in which nothing but the cameras matters."""
    lens = Lens((640, 480), np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.zeros(0))
    rig = Rig(tuple(Camera(name, lens, Pose(np.eye(3), np.zeros(3))) for name in names))
    seen = passerby.Observations({})
    inputs = SceneInputs(rig, seen, findings=())
    estimate = Estimate(Solution("people", rig, "accepted"), Association(seen, seen, {}))
    return GroupEstimate(inputs, inputs, estimate, Corrections(), LensExamination(), (), 0.0)


def test_a_joint_that_contradicts_its_groups_is_tried_without_the_passage_that_is_seen_least(monkeypatch):
    groups = [group_of(names) for names in (("a", "b"), ("c", "d"), ("e", "f"))]

    def door(first: int, second: int, votes: int, known: bool = True) -> Door:
        passage = Passage(GroundMotion(1.0, 0.0, 0.0), 0.0, votes, 5, np.ones((2, 2), np.int64), known)
        return Door(groups[first].rig.names, groups[second].rig.names, passage)

    doors = {(0, 1): door(0, 1, 20), (1, 2): door(1, 2, 50), (0, 2): door(0, 2, 90, known=False)}
    tried = []

    def joined(run, inputs, own, between):
        tried.append((len(own), sorted(between)))
        return group_of(tuple(name for one in own for name in one.rig.names)) if len(own) == 2 else None

    monkeypatch.setattr(calibrate_module, "find_doors", lambda run, found: doors)
    monkeypatch.setattr(calibrate_module, "join_estimates", joined)
    scene = Scene.model_validate(
        {"scene": {"name": "s"}, "cameras": {name: {"tracks": "t.txt", "intrinsics": "rig.toml"} for name in "abcdef"}}
    )
    found = calibrate_module.join_by_passages(CalibrationRun(scene, PeopleOptions()), groups[0].stated, groups)
    assert tried == [(3, [(0, 1), (1, 2)]), (2, [(0, 1)])]
    assert [one.rig.names for one in found] == [("a", "b"), ("c", "d", "e", "f")]
    assert found[0].nearest is doors[0, 2]  # with most of the people who are needed


@pytest.mark.slow
def test_groups_of_the_scene_file_are_the_pairs_of_the_calibration():
    scene = simulate(SimulationOptions(seed=807, seconds=20.0, unrelated_ids=True, box_noise=0.01))
    boxes = {name: seen.boxes for name, seen in scene.observations.cameras.items()}
    groups = [["C1", "C2", "C3"], ["C3", "C4"]]
    tables = {"sites": {"groups": groups}, "association": {"max_offset_s": 0}}
    found = passerby.calibrate_observations(scene.rig, boxes, fps=5.0, **tables)
    assert found.association is not None
    figures = found.association.figures
    assert figures.pairs_tried.tried == figures.pairs_tried.stated == 4
    assert {frozenset(pair.cameras) for pair in figures.pairs} == {
        frozenset(pair) for pair in (("C1", "C2"), ("C1", "C3"), ("C2", "C3"), ("C3", "C4"))
    }
    assert len(found.rig.posed()) == 4


@pytest.mark.parametrize(
    ("count", "search_s", "options", "all_pairs"),
    [
        (4, 5.0, AssociationOptions(), True),
        (40, 5.0, AssociationOptions(), False),
        (40, 0.0, AssociationOptions(mode="trajectory"), False),
        (40, 5.0, AssociationOptions(mode="appearance"), True),
        (40, 600.0, AssociationOptions(), True),
        (3, 600.0, AssociationOptions(mode="appearance", groups=(("C1", "C3"),)), False),
    ],
)
def test_all_pairs_are_compared_of_few_cameras_by_looks_and_where_starts_are_unknown(count, search_s, options, all_pairs):
    cameras = [SimpleNamespace(name=f"C{number + 1}", tracks=None) for number in range(count)]
    found = _find_candidates(cameras, search_s, options, silent)
    assert (found is None) == all_pairs
    if options.groups:
        assert list(found.found_by) == [(0, 2)]
