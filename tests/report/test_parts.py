"""What the page is put together from: escaping, fixes, uses of a doubtful rig, stretches of time, weak points, distances."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from passerby.common.errors import InputError
from passerby.core.measuring import MeasuringFigures, MeasuringSigma
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.findings.finding import doubt, notice
from passerby.report.contents import contents_from
from passerby.report.distances import best_to_measure, distances_of, outstanding, weak_points
from passerby.report.headline import _people_label
from passerby.report.recommendations import FOR_ANY, Point, good_for, points_of, reported_doubts, sentence
from passerby.report.rendering import environment, plot
from passerby.report.seen import find_seen, lanes_of, merge_spells
from passerby.report.view_graph import links_of
from support.report.pages import busy_place, changed, diagnosed, document_of, with_figures


def filled(source, **values):
    return environment().from_string(source).render(values)


@given(st.text())
def test_no_text_becomes_markup(text):
    inside = filled('<p title="{{ text }}">{{ text }}</p>', text=text)
    assert inside.count("<") == 2
    assert inside.count(">") == 2
    assert '"' not in inside[len('<p title="') : inside.index('">')]


@given(st.dictionaries(st.text(), st.text()))
def test_no_json_ends_its_script(value):
    drawn = filled('{% from "macros.html" import plot %}{{ plot(drawn) }}', drawn=plot("one", value, "a plot"))
    script = drawn[drawn.index("<script") : drawn.index("</script>")]
    inside = script[script.index(">") + 1 :]
    assert "<" not in inside
    assert json.loads(inside) == value


def points(*findings):
    return written(**diagnosed(*findings))


def written(**tables):
    """The points of a `calibration.json` that has these tables."""
    return points_of(reported_doubts(document_of({"verdict": "doubtful", "cameras": [], **tables})))


def test_a_doubt_is_a_problem_and_a_remedy_also_if_its_sentence_has_none():
    few, slow = doubt("few_observations", "C1", agreeing=7), doubt("adjustment_not_converged")
    assert points(few, slow, notice("frame_rate_missing", place="scene.toml")) == [
        Point("Camera C1 has only 7 supporting observations.", "Record more people in its view."),
        Point("The adjustment did not converge.", "Under [solver.options] set max_iterations = 200."),
    ]
    cut = doubt("smaller_image_fits", "V1", place="V1.txt", seen_size=[96, 54], size=[192, 108], cut=5)
    (point,) = points(cut)
    assert point.problem.startswith("V1.txt: camera V1: its people seem to be detected in images of 96 x 54")
    assert point.remedy.startswith("Give intrinsics for images of that size")
    (point,) = points(doubt("few_inliers", "C1", share=0.2))
    assert point.problem == "Only 20% of the points that camera C1 shares with the reference agree with its pose."
    assert point.remedy == "Record people walking where the views of these cameras overlap."


def test_findings_of_another_passerby_are_shown_as_they_stand():
    row = {"code": "eaten", "severity": "doubt", "cameras": ["C1"], "values": {}, "text": "a dog ate it", "remedy": "feed it"}
    assert written(diagnostics=[row]) == [Point("A dog ate it.", "Feed it.")]
    lacking = {**row, "code": "few_observations"}
    assert written(diagnostics=[lacking]) == [Point("A dog ate it.", "Feed it.")]
    (point,) = written(reasons=["a dog ate it: feed it"])
    assert point == Point("A dog ate it: feed it.", sentence(FOR_ANY))
    for wrong, says in (("none", "diagnostics is 'none'"), ([{**row, "cameras": 5}], "diagnostics.0.cameras is 5")):
        with pytest.raises(InputError, match=says):
            written(diagnostics=wrong)


@pytest.mark.parametrize(
    ("code", "values", "names", "problem"),
    [
        ("few_walkers", {}, "ABC", "Cameras A, B and C saw too few people who walk for a second or longer."),
        ("few_observations", {"agreeing": 3}, "ABC", "Camera A has only 3 supporting observations (likewise cameras B and C)."),
        ("few_walkers", {}, ("cam1", "cam12", "north gate", "a.b"),
         "Cameras cam1, cam12, north gate and a.b saw too few people who walk for a second or longer."),
    ],
)  # fmt: skip
def test_a_problem_of_several_cameras_is_said_once(code, values, names, problem):
    (point,) = points(*(doubt(code, name, **values) for name in names))
    assert point.problem == problem


def test_a_path_keeps_its_spelling():
    for path, begins in (("single/cam01.mp4",) * 2, ("scene.toml",) * 2, ("C1.mp4",) * 2, ("videos", "Videos:")):
        assert sentence(f"{path}: camera C1: 3 pictures could not be decoded").startswith(begins)
    assert sentence("people stand") == "People stand."


@pytest.mark.parametrize(
    ("mode", "used", "label"),
    [("given", True, "people used"), ("combined", True, "tracks used"), ("combined", False, "tracks")],
)
def test_tracks_are_not_called_people(mode, used, label):
    """Who is found by how people move is one person in several pieces: 51 of these were 14 people."""
    tables = {"verdict": "accepted", "cameras": [], "scene": {"association": {"mode": mode}}}
    contents = SimpleNamespace(document=document_of(tables))
    assert _people_label(contents, used) == label


POINTS = MeasuringSigma(median_mm=31.0, p90_mm=60.0)
MEASURING = MeasuringFigures(places=9, points=POINTS, ground=POINTS.scaled(3.0), ground_height_mm=34.0, cameras={})


def uncertain(what, *cameras, sigma=None, lacks=()):
    return doubt("rig_uncertain", *cameras, what=what, sigma=sigma, lacks=list(lacks), why=None)


SCALE, UP = uncertain("scale", sigma=14.0), uncertain("ground", lacks=("vertical",))
FEW = uncertain("points", "C1", sigma=600.0)
LAYOUT = "Still good for the rough layout of the cameras and for counting people."


@pytest.mark.parametrize(
    ("doubts", "text"),
    [
        ([FEW], "Still good for what cameras C2, C3 see: points to 3 cm, positions on the ground to 9 cm (1 sigma)."),
        ([SCALE], "Still good for what the cameras see, up to the scale; not for the scale."),
        ([UP], "Still good for what the cameras see: points to 3 cm (1 sigma); not for the up direction and the ground."),
        ([FEW, uncertain("points", "C2", sigma=700.0)], LAYOUT),
        ([uncertain("points")], LAYOUT),
    ],
)
def test_one_line_says_what_a_doubtful_rig_is_still_good_for(doubts, text):
    assert good_for(doubts, ("C1", "C2", "C3"), MEASURING) == text


def seen_at(*frames_of_people):
    rows = [(frame, identity) for identity, frames in enumerate(frames_of_people, start=1) for frame in frames]
    frame, identity = np.array(rows).T
    return CameraObservations(Boxes(frame, identity, np.tile([0.0, 0, 10, 30], (len(rows), 1)), np.ones(len(rows))))


def contents_with(seen, clocks=None, fps=5.0):
    contents = busy_place(cameras=3, people=2, seconds=20, fps=5.0)
    empty = dict.fromkeys(contents.rig.names, CameraObservations())
    observations = Observations(empty | dict(zip(contents.rig.names, seen, strict=False)), fps, clocks or {})
    return replace(contents, observations=observations, clocks=clocks or {})


def test_short_breaks_are_closed_long_ones_kept_and_stretches_follow_the_cameras_clocks():
    spells = find_seen(contents_with([seen_at([1, 2, 4, 5, 6, 20, 21], [3, 4])])).spells
    assert spells.identity.tolist() == [1, 2, 1]
    assert spells.begin.tolist() == pytest.approx([0.0, 0.4, 3.8])
    assert spells.end.tolist() == pytest.approx([1.2, 0.8, 4.2])
    assert spells.in_seconds

    contents = contents_with([seen_at([1, 2]), seen_at([11, 12])], fps=None)
    assert not find_seen(contents).spells.in_seconds
    names = contents.rig.names
    clocks = {names[0]: Clock(5.0), names[1]: Clock(10.0, 3.0), names[2]: Clock(5.0)}
    spells = find_seen(replace(contents, clocks=clocks)).spells
    assert spells.begin.tolist() == [0.0, 4.0]


def test_merging_closes_the_shortest_breaks_and_loses_no_person():
    spells = find_seen(busy_place(cameras=2, people=20, seconds=900, fps=2.0)).spells
    fewer = merge_spells(spells, len(spells) // 2)
    assert len(fewer) == len(spells) // 2

    def ends(one):
        own = {(camera, who): (one.camera == camera) & (one.identity == who) for camera in range(2) for who in one.people}
        return {key: (one.begin[rows].min(), one.end[rows].max()) for key, rows in own.items() if rows.any()}

    assert ends(fewer) == ends(spells)
    assert merge_spells(spells, len(spells)) is spells


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(1, 20)), max_size=40))
def test_no_two_stretches_overlap_in_a_lane(stretches):
    begin = np.array(sorted(start for start, _ in stretches), dtype=float)
    end = begin + np.array([length for _, length in stretches], dtype=float)
    lanes = lanes_of(begin, end)
    for lane in range(int(lanes.max()) + 1 if len(lanes) else 0):
        own = lanes == lane
        assert (begin[own][1:] >= end[own][:-1]).all()
    if len(lanes):
        assert lanes.max() + 1 == max(np.count_nonzero((begin <= at) & (end > at)) for at in begin)


def test_shared_sightings_are_those_at_the_same_time():
    first, second = seen_at([1, 2, 3], [1, 2]), seen_at([2, 3, 4], [7])
    contents = contents_with([first, second])
    shared = find_seen(contents).shared[contents.rig.names[:2]]
    assert (shared.people, shared.sightings) == (1, 2)
    clocks = dict.fromkeys(contents.rig.names, Clock(5.0)) | {contents.rig.names[1]: Clock(5.0, -0.2)}
    shifted = find_seen(replace(contents, clocks=clocks)).shared[contents.rig.names[:2]]
    assert (shifted.people, shifted.sightings) == (1, 3)


def test_a_camera_that_stands_out_is_named_with_a_mend():
    assert outstanding({"A": 1.0, "B": 1.1, "C": 5.0, "D": None}) == ["C"]
    assert outstanding({"A": 1.0, "B": 5.0}) == []
    contents = busy_place(cameras=4, people=5, seconds=60, fps=2.0)
    bad = contents.rig.names[2]
    cameras = [{"name": one.name, "shape_position_sigma_mm": 300.0 if one.name == bad else 30.0} for one in contents.rig]
    worse = with_figures(contents, cameras=cameras)
    points = weak_points(worse, find_seen(worse))
    assert any(bad in point.problem and "300 mm" in point.problem and point.remedy for point in points)
    told = changed(worse, **diagnosed(doubt("few_observations", bad, agreeing=3)))
    assert not any(bad in point.problem for point in weak_points(told, find_seen(told)))
    assert "3.0 %" in points[0].problem
    assert "[[scale.distances]]" in points[0].remedy


def test_distances_and_their_sigmas():
    contents = busy_place(cameras=4, people=3, seconds=20, fps=2.0)
    first, second = contents.rig.names[:2]
    metres = float(np.linalg.norm(contents.rig[first].centre - contents.rig[second].centre))
    solved = {"cameras": [second, first], "metres": metres / 2, "sigma_m": 0.05}  # the world was scaled since
    found = {(one.first, one.second): one for one in distances_of(with_figures(contents, distances=[solved]))}
    assert len(found) == 6
    assert (found[first, second].metres, found[first, second].sigma_m) == pytest.approx((metres, 0.1))
    assert sum(one.sigma_m is None for one in found.values()) == 5
    found = distances_of(contents)
    assert best_to_measure(found).metres == max(one.metres for one in found if one.metres < 30)
    far = [replace(one, metres=one.metres + 100) for one in found]
    assert best_to_measure(far).metres == min(one.metres for one in far)


def test_links_take_the_best_route_and_tell_all():
    contents = busy_place(cameras=3, people=4, seconds=60, fps=2.0)
    a, b, c = contents.rig.names
    pairs = [
        {"cameras": [b, a], "route": "ground", "inliers": 30, "matches": 100, "support": 0.5},
        {"cameras": [a, b], "route": "epipolar", "inliers": 90, "matches": 100, "support": 1.0},
        {"cameras": [a, c], "route": "ground", "inliers": 50, "matches": 100, "support": 1.0},
    ]
    links = {(link.first, link.second): link for link in links_of(with_figures(contents, pairs=pairs), find_seen(contents))}
    assert links[a, b].confidence == pytest.approx(0.9)
    assert (links[a, b].word, links[a, c].word, links[b, c].word) == ("strong", "fair", "not used")
    assert links[a, b].routes == ("ground", "epipolar")


def test_a_rigs_names_do_not_lead_out_of_the_folder(calibrated, tmp_path):
    out = calibrated[1]
    (tmp_path / "inner" / "tracks").mkdir(parents=True)
    (tmp_path / "secret.txt").write_text((out / "tracks" / "C1.txt").read_text())
    for name in ("calibration.json", "rig.toml"):
        (tmp_path / "inner" / name).write_text((out / name).read_text().replace("C1", "../../secret"))
    text = (tmp_path / "inner" / "rig.toml").read_text().replace("[../../secret]", '["../../secret"]')
    (tmp_path / "inner" / "rig.toml").write_text(text)
    told = json.loads((tmp_path / "inner" / "calibration.json").read_text())
    (tmp_path / "inner" / "calibration.json").write_text(json.dumps({**told, "files": {}}))  # as who means harm would write it
    contents = contents_from(tmp_path / "inner")
    assert contents.rig.names[0] == "../../secret"
    assert len(contents.observations["../../secret"].boxes) == 0
