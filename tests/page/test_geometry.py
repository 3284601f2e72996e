"""What the page says by a rig: against the rig's own projections, and of the same person in other cameras."""

import numpy as np
import pytest

from passerby.calibration.alignment.lengths import measure_length
from passerby.common.errors import EvidenceError, InputError
from passerby.core.cameras import Lens
from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, write_document
from passerby.page import geometry
from passerby.page.geometry import epipolar_lines, ground_point, measure_axis
from support.scenes.people_and_rigs import ring, without_poses

from .conftest import refusal

BENT = Lens((1280, 720), np.array([[700.0, 0, 640], [0, 700.0, 360], [0, 0, 1]]), np.array([-0.25, 0.06, 0.0, 0.0]))
POINTS = np.array([[1.0, 0.5, 0.0], [-1.5, 2.0, 1.2]])


@pytest.fixture
def rig():
    return ring(4, lens=BENT)


def distance(curve, at):
    """From a point to a curve of pixels."""
    start, step = curve[:-1], np.diff(curve, axis=0)
    along = np.clip(((at - start) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0, 1)
    return float(np.linalg.norm(start + along[:, None] * step - at, axis=1).min())


def test_the_epipolar_line_leads_through_the_point_bent_as_the_lens_bends_it(rig):
    first, *others = rig.names
    for point in POINTS:
        at = tuple(rig[first].project(point)[0])
        lines = {one.camera: one.line for one in epipolar_lines(rig, first, at)}
        assert sorted(lines) == sorted(others)
        for name, line in lines.items():
            pixels = np.array([pixel for pixel, _ in line])
            assert distance(pixels, rig[name].project(point)[0]) < 0.2


@pytest.mark.slow
def test_the_band_holds_the_clicks_of_a_noisy_hand():
    """Two pixels of noise in both coordinates: the band of two sigma holds 95 %."""
    rng, rig = np.random.default_rng(3), ring(2, lens=BENT)
    first, second = rig.names[:2]
    at, true = rig[first].project(POINTS[0])[0], rig[second].project(POINTS[0])[0]
    inside = []
    for _ in range(60):
        lines = epipolar_lines(rig, first, tuple(at + rng.normal(scale=2.0, size=2)))
        line = next(one.line for one in lines if one.camera == second)
        pixels, width = np.array([pixel for pixel, _ in line]), np.array([wide for _, wide in line])
        nearest = int(np.argmin(np.linalg.norm(pixels - true, axis=1)))
        inside.append(distance(pixels, true) <= width[nearest])
    assert np.mean(inside) >= 0.85
    assert width[nearest] < 16


def test_a_length_a_heading_and_their_sigmas_are_those_of_noisy_clicks(rig):
    rng, names = np.random.default_rng(4), rig.names[:2]
    clicks = {name: rig[name].project(POINTS) for name in names}
    exact = measure_length(rig, clicks)
    assert exact.metres == pytest.approx(np.linalg.norm(POINTS[1] - POINTS[0]), abs=1e-6)
    assert exact.residual_px < 1e-6
    noisy = []
    for _ in range(200):
        ends = rig.triangulate({name: clicks[name] + rng.normal(scale=2.0, size=(2, 2)) for name in names})
        noisy.append(np.linalg.norm(ends[1] - ends[0]))
    assert np.std(noisy) == pytest.approx(exact.sigma_m, rel=0.25)

    rng, name = np.random.default_rng(6), names[0]
    ends = np.array([[1.0, 0.5, 0.0], [-1.5, 2.0, 0.0]])
    found = measure_axis(rig, [(name, tuple(pixel)) for pixel in rig[name].project(ends)])
    assert found.metres == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=1e-6)
    headings = []
    for _ in range(200):
        noisy = rig[name].project(ends) + rng.normal(scale=2.0, size=(2, 2))
        along = np.diff([ground_point(rig, name, tuple(at)) for at in noisy], axis=0)[0]
        headings.append(np.degrees(np.arctan2(along[1], along[0])))
    assert np.std(headings) == pytest.approx(found.heading_sigma_deg, rel=0.2)


def test_a_pixel_of_the_ground_is_where_it_is_on_the_ground(rig):
    name = rig.names[0]
    assert ground_point(rig, name, tuple(rig[name].project(POINTS[0])[0])) == pytest.approx(POINTS[0], abs=1e-6)
    with pytest.raises(InputError, match="above the horizon"):
        ground_point(rig, name, (640.0, 0.0))
    with pytest.raises(EvidenceError, match="no pose yet"):
        epipolar_lines(without_poses(rig), name, (1.0, 1.0))


CLOCKS = {"C1": (10.0, 0.0), "C2": (5.0, 2.0), "C3": (10.0, -1.0), "C4": (10.0, 0.0)}
"""Frames per second, and the rig's time at frame 1."""
TRACKS = {
    "C1": [(101, 7, 10, 20, 30, 60), (101, 8, 100, 20, 30, 60), (105, 7, 12, 20, 30, 60)],
    # The click is at 10 s: here frame 41.
    "C2": [(30, 7, 1, 1, 20, 50), (40, 7, 2, 2, 20, 50), (41, 8, 3, 3, 20, 50), (44, 7, 4, 4, 20, 50)],
    # Here frame 111.
    "C3": [(110, 9, 5, 5, 20, 50), (111, 7, 6, 6, 20, 50)],
    "C4": [(101, 8, 7, 7, 20, 50)],
}


def write_calibration(session, tracks=TRACKS, clocks=CLOCKS, verdict="accepted"):
    """A calibration with these boxes (frame, identity, left, top, width, height) by camera."""
    (session.out / "tracks").mkdir(exist_ok=True)
    cameras = []
    for name, (fps, offset) in clocks.items():
        text = "".join(",".join(map(str, (*row, 1, -1, -1, -1))) + "\n" for row in tracks[name])
        (session.out / "tracks" / f"{name}.txt").write_text(text)
        cameras.append(CameraEntry(name=name, boxes=len(tracks[name]), fps=fps, time_offset_s=offset))
    write_document(session.out, CalibrationDocument(verdict=verdict, cameras=tuple(cameras)))


def ask(client, camera="C1", frame=101, at=(25, 50)):
    return client.post("/api/person", {"camera": camera, "frame": frame, "at": at})


def test_each_camera_shows_the_identity_at_the_nearest_moment(client, session, monkeypatch):
    write_calibration(session)
    told = ask(client).json()
    assert told["identity"] == 7
    assert [(one["camera"], one["frame"], one["box"], one["late_s"]) for one in told["seen"]] == [
        ("C1", 101, [10, 20, 30, 60], 0.0), ("C3", 111, [6, 6, 20, 50], 0.0), ("C2", 40, [2, 2, 20, 50], -0.2),
    ]  # fmt: skip
    assert (told["unseen"], told["further"]) == (["C4"], [])
    assert told["seen"][0]["size"] == list(session.rig()["C1"].lens.size)
    # As for a known height: a calibration that samples every few frames knows nothing of those between.
    assert ask(client, frame=103).json()["identity"] == 7
    assert ask(client, frame=140).json() == {"identity": None, "seen": [], "further": [], "unseen": []}
    assert ask(client, at=(5, 5)).json()["identity"] is None
    monkeypatch.setattr(geometry, "MOST_SHOWN", 1)
    told = ask(client).json()
    assert ([one["camera"] for one in told["seen"]], told["further"]) == (["C1", "C3"], ["C2"])
    write_calibration(session, {**TRACKS, "C1": [(101, 12345, 10, 20, 30, 60)]})
    assert ask(client).json()["identity"] == 12345, "a new calibration is read anew"


def test_frames_that_are_counted_alike_need_no_clocks(client, session):
    write_calibration(session, clocks=dict.fromkeys(CLOCKS, (None, None)))
    told = ask(client, "C2", 44, (10, 10)).json()
    assert [(one["camera"], one["frame"], one["late_s"], one["late_frames"]) for one in told["seen"]] == [
        ("C2", 44, None, 0), ("C1", 101, None, 57), ("C3", 111, None, 67),
    ]  # fmt: skip


def test_a_request_for_a_person_that_cannot_be_answered_is_refused(client, session):
    assert "calibrate first" in ask(client).json()["error"]
    write_calibration(session)
    assert "no pose in the last calibration" in ask(client, camera="../C1").json()["error"]
    for body in (b"[]", b'{"camera": "C1", "frame": -1, "at": [1, 1]}', b'{"camera": 1}'):
        assert client.post("/api/person", body).status == 422
    write_calibration(session, verdict="refused")
    said = refusal(ask(client))
    assert "refused" in said
    assert str(session.out.parent) not in said
