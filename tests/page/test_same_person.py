"""The same person in the other cameras: by identity and by the clocks of the last calibration."""

import json

import pytest

from passerby.interchange.calibration_json import CalibrationDocument, CameraEntry, write_document
from passerby.page import geometry

CLOCKS = {"C1": (10.0, 0.0), "C2": (5.0, 2.0), "C3": (10.0, -1.0), "C4": (10.0, 0.0)}
"""Frames per second, and the rig's time at frame 1."""


def write_calibration(session, tracks, clocks=CLOCKS, verdict="accepted"):
    """A calibration with these boxes (frame, identity, left, top, width, height) by camera."""
    (session.out / "tracks").mkdir(exist_ok=True)
    cameras = []
    for name, (fps, offset) in clocks.items():
        rows = tracks.get(name, [])
        text = "".join(",".join(map(str, (*row, 1, -1, -1, -1))) + "\n" for row in rows)
        (session.out / "tracks" / f"{name}.txt").write_text(text)
        cameras.append(CameraEntry(name=name, boxes=len(rows), fps=fps, time_offset_s=offset))
    write_document(session.out, CalibrationDocument(verdict=verdict, cameras=tuple(cameras)))


def ask(client, camera="C1", frame=101, at=(25, 50)):
    body = json.dumps({"camera": camera, "frame": frame, "at": at}).encode()
    return client.post("/api/person", body)


TRACKS = {
    "C1": [(101, 7, 10, 20, 30, 60), (101, 8, 100, 20, 30, 60), (105, 7, 12, 20, 30, 60)],
    # The click is at 10 s: here frame 41.
    "C2": [(30, 7, 1, 1, 20, 50), (40, 7, 2, 2, 20, 50), (41, 8, 3, 3, 20, 50), (44, 7, 4, 4, 20, 50)],
    # Here frame 111.
    "C3": [(110, 9, 5, 5, 20, 50), (111, 7, 6, 6, 20, 50)],
    "C4": [(101, 8, 7, 7, 20, 50)],
}


def test_each_camera_shows_the_identity_at_the_nearest_moment(client, session):
    write_calibration(session, TRACKS)
    told = ask(client).json()
    assert told["identity"] == 7
    assert [(one["camera"], one["frame"], one["box"], one["late_s"]) for one in told["seen"]] == [
        ("C1", 101, [10, 20, 30, 60], 0.0), ("C3", 111, [6, 6, 20, 50], 0.0), ("C2", 40, [2, 2, 20, 50], -0.2),
    ]  # fmt: skip
    assert told["unseen"] == ["C4"]
    assert told["further"] == []
    assert told["seen"][0]["size"] == list(session.rig()["C1"].lens.size)


def test_frames_that_are_counted_alike_need_no_clocks(client, session):
    write_calibration(session, TRACKS, dict.fromkeys(CLOCKS, (None, None)))
    told = ask(client, "C2", 44, (10, 10)).json()
    assert [(one["camera"], one["frame"], one["late_s"], one["late_frames"]) for one in told["seen"]] == [
        ("C2", 44, None, 0), ("C1", 101, None, 57), ("C3", 111, None, 67),
    ]  # fmt: skip


def test_the_frame_with_people_near_the_click_is_taken(client, session):
    """As for a known height: a calibration that samples every few frames knows nothing of those between."""
    write_calibration(session, TRACKS)
    assert ask(client, frame=103).json()["identity"] == 7
    assert ask(client, frame=140).json() == {"identity": None, "seen": [], "further": [], "unseen": []}
    assert ask(client, at=(5, 5)).json()["identity"] is None


def test_only_so_many_pictures_are_asked_for(client, session, monkeypatch):
    monkeypatch.setattr(geometry, "MOST_SHOWN", 1)
    write_calibration(session, TRACKS)
    told = ask(client).json()
    assert ([one["camera"] for one in told["seen"]], told["further"]) == (["C1", "C3"], ["C2"])


def test_a_new_calibration_is_read_anew(client, session):
    write_calibration(session, TRACKS)
    assert ask(client).json()["identity"] == 7
    write_calibration(session, {**TRACKS, "C1": [(101, 12345, 10, 20, 30, 60)]})
    assert ask(client).json()["identity"] == 12345


def test_what_cannot_be_told_is_said(client, session):
    assert "calibrate first" in ask(client).json()["error"]
    write_calibration(session, TRACKS)
    assert "no pose in the last calibration" in ask(client, camera="../C1").json()["error"]
    write_calibration(session, TRACKS, verdict="refused")
    answer = ask(client)
    assert answer.status == 422
    assert "refused" in answer.json()["error"]
    assert str(session.out.parent) not in answer.json()["error"]


@pytest.mark.parametrize("body", [b"[]", b'{"camera": "C1", "frame": -1, "at": [1, 1]}', b'{"camera": 1}'])
def test_what_names_nobody_is_refused(client, session, body):
    write_calibration(session, TRACKS)
    assert client.post("/api/person", body).status == 422
