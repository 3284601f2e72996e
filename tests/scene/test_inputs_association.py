"""Input whose identities are not given: tracklets or detections, embeddings, frame rates, cameras without people."""

import json
from pathlib import Path

import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.core.observations import Clock
from passerby.findings.texts import texts_of
from passerby.interchange.motchallenge import write_embeddings
from passerby.interchange.storage.safe_parsing import faults_of
from passerby.scene.inputs import read_inputs
from passerby.scene.reading import read_camera
from passerby.scene.scene import Scene
from support.scenes.handmade_files import lens, rows, write_scene
from support.scenes.puppet_videos import film, puppets, scene_file

COMBINED = 'mode = "combined"'
GIVEN = 'mode = "given"'
DETECTIONS = rows(identities=(-1, -1))


def read(folder, *arguments, **named):
    return read_inputs(Scene.load(write_scene(folder, *arguments, **{"association": COMBINED, **named})))


def looks(seed, dimensions=4, count=20):
    vectors = np.random.default_rng(seed).normal(size=(count, dimensions))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def with_looks(folder, *names, frame=None, **named):
    for index, name in enumerate(names):
        write_embeddings(folder / f"{name}.npz", looks(index, **named), frame)


CAMERA_C = '[cameras.C]\nintrinsics = "c.toml"\n'
TWO_AND_C = {"c.toml": lens("C")}


def test_rows_without_an_id_are_kept_and_tracks_go_before_detections(tmp_path):
    found = read(tmp_path, files={"A.txt": rows() + "11,-1,9,9,9,9,1,-1,-1,-1\n", "B.txt": DETECTIONS})
    assert found.observations["A"].boxes.identity.tolist() == [1, 2] * 10 + [-1]
    assert found.observations["B"].boxes.identity.tolist() == [-1] * 20
    files = {"C.txt": rows(identities=(7, -1)), **TWO_AND_C}
    found = read(tmp_path, extra=CAMERA_C + 'detections = "C.txt"', files=files)
    assert found.observations["C"].boxes.identity.tolist() == [7, -1] * 10
    found = read(tmp_path, extra='detections = "C.txt"', files={"C.txt": DETECTIONS})
    assert (found.observations["B"].boxes.identity > 0).all()
    assert ("detections_unused", ("B",)) in [(notice.code, notice.cameras) for notice in found.findings]


@pytest.mark.parametrize(
    ("association", "extra", "clocks", "noted"),
    [
        (COMBINED, "", {}, "frame_rate_missing"),
        (COMBINED + "\nmax_offset_s = 0", "", {}, None),
        (COMBINED, "[scene]\nfps = 25", {"A": 25, "B": 25}, None),
        (GIVEN, "", {}, None),
        (GIVEN, "fps = 25\n[scene]\nfps = 25", {}, None),
        (GIVEN, "fps = 28\n[scene]\nfps = 25", {"A": 25, "B": 28}, None),
        (GIVEN + "\nmax_offset_s = 2", "[scene]\nfps = 25", {"A": 25, "B": 25}, None),
    ],
)
def test_clocks_by_frame_rate(tmp_path, association, extra, clocks, noted):
    found = read(tmp_path, association=association, extra=extra)
    assert found.observations.clocks == {name: Clock(fps) for name, fps in clocks.items()}
    assert found.observations.fps == (25 if "fps" in extra else None)
    assert [notice.code for notice in found.findings] == ([noted] if noted else [])


def test_a_frame_rate_that_contradicts_the_others_is_named(tmp_path):
    names, odd = ("A", "B", "C", "D"), "D 0.8 s (frames 1 to 41 at 50 fps); the other cameras have about 1.6 s: check fps"
    scene = write_scene(tmp_path, names, association=COMBINED, files={f"{name}.txt": rows(41) for name in names})
    stated = scene.read_text()
    for last, expected in ((30, []), (50, [odd])):
        text = stated
        for name, rate in zip(names, (25, 25, 25, last), strict=True):
            text = text.replace(f'tracks = "{name}.txt"', f'tracks = "{name}.txt"\nfps = {rate}')
        scene.write_text(text)
        found = texts_of(read_inputs(Scene.load(scene)).findings)
        assert [part for text, part in zip(found, expected, strict=True) if part not in text] == []


def test_embeddings_stay_with_their_boxes(tmp_path):
    with_looks(tmp_path, "A", "C", frame=np.repeat(np.arange(1, 11), 2))
    extra = CAMERA_C + 'detections = "C.txt"\nembeddings = "C.npz"'
    scene = write_scene(tmp_path, association=COMBINED, extra=extra, files={"C.txt": DETECTIONS, **TWO_AND_C})
    scene.write_text(scene.read_text().replace('tracks = "A.txt"', 'tracks = "A.txt"\nembeddings = "A.npz"'))
    found = read_inputs(Scene.load(scene))
    for index, name in enumerate("AC"):
        np.testing.assert_allclose(found.observations[name].boxes.embedding, looks(index), atol=1e-6)
    assert found.observations["B"].boxes.embedding is None
    assert ("embeddings_missing", ("B",)) in [(notice.code, notice.cameras) for notice in found.findings]
    # In mode "given" they follow the people who are known.
    with_looks(tmp_path, "B", count=21)
    files = {"B.txt": "1,-1,9,9,9,9,1,-1,-1,-1\n" + rows()}
    found = read(tmp_path, association=GIVEN, extra='embeddings = "B.npz"', files=files)
    np.testing.assert_allclose(found.observations["B"].boxes.embedding, looks(0, count=21)[1:], atol=1e-6)
    (unused,) = [notice for notice in found.findings if notice.code == "unused_with_identities"]
    assert (unused.cameras, unused.values["key"]) == (("B",), "embeddings")


@pytest.mark.parametrize(
    ("appearance", "told"),
    [
        (None, "B.npz: no such file"),
        ({"count": 12}, "B.npz: 12 embeddings for 20 boxes: give one row for each row of {}/B.txt, in its order"),
        ({"frame": np.arange(1, 21)}, "B.npz: row 2 is of frame 2, but that row of {}/B.txt is of frame 1"),
        ({"dimensions": 7}, "[cameras.B] embeddings have 7 dimensions, those of camera A 4: take them from the same network"),
    ],
)
def test_embeddings_that_do_not_fit(tmp_path, capsys, appearance, told):
    with_looks(tmp_path, "A")
    if appearance is not None:
        with_looks(tmp_path, "B", **appearance)
    scene = write_scene(tmp_path, association=COMBINED, extra='embeddings = "B.npz"')
    scene.write_text(scene.read_text().replace('tracks = "A.txt"', 'tracks = "A.txt"\nembeddings = "A.npz"'))
    for command in (["check", str(scene)], ["calibrate", str(scene), "-o", str(tmp_path / "out")]):
        assert run(command) == 2
        assert told.format(tmp_path) in capsys.readouterr().err


def test_appearance_needs_embeddings(tmp_path):
    mode, extra = 'mode = "appearance"', 'embeddings = "B.npz"\n'
    told = r"no camera has any: give each camera embeddings .*: under \[association\] set mode = .combined."
    with pytest.raises(InputError, match=told):
        read(tmp_path, association=mode)
    with_looks(tmp_path, "B")
    with pytest.raises(InputError, match=r"\[cameras.A\] mode .appearance. needs embeddings: give each camera") as caught:
        read(tmp_path, association=mode, extra=extra + CAMERA_C + 'tracks = "C.txt"', files={"C.txt": "", **TWO_AND_C})
    assert len(faults_of(caught.value)) == 1  # A's; who saw nobody needs none


@pytest.mark.parametrize(
    ("files", "told"),
    [
        ({"B.txt": ""}, "only camera A saw anybody: a calibration needs"),
        ({"A.txt": "", "B.txt": ""}, "no camera saw anybody"),
        ({"B.txt": None}, "no such file"),
    ],
)
def test_fewer_than_two_cameras_that_saw_anybody_are_an_error_and_one_of_three_is_a_finding(tmp_path, files, told):
    with pytest.raises(InputError, match=told) as caught:
        read(tmp_path, files=files)
    assert len(faults_of(caught.value)) == 1
    found = read(tmp_path, ("A", "B", "C"), files={"C.txt": ""})
    assert (len(found.observations["C"].boxes), found.rig.names) == (0, ("A", "B", "C"))
    (blind,) = [notice for notice in found.findings if notice.code == "camera_saw_nobody"]
    assert (blind.cameras, blind.values["watched"]) == (("C",), False)


def test_check_shows_tracklets_detections_and_people_shared_at_the_same_time(tmp_path, capsys):
    with_looks(tmp_path, "B")
    files = {"B.txt": DETECTIONS, "C.txt": rows(identities=(8, 9, 10)), "D.txt": ""}
    extra = "[scene]\nfps = 2.5"
    scene = write_scene(tmp_path, ("A", "B", "C", "D"), association=COMBINED, files=files, extra=extra)
    scene.write_text(scene.read_text().replace('tracks = "B.txt"', 'tracks = "B.txt"\nembeddings = "B.npz"'))
    assert run(["check", str(scene)]) == 0
    out = capsys.readouterr().out
    assert "shared" not in out
    head, *lines = (line.split() for line in out.splitlines()[1:6])
    table = {line[0]: dict(zip(head, line, strict=True)) for line in lines}
    assert [table[name]["tracklets"] for name in "ABCD"] == ["2", "detections", "3", "0"]
    assert [table[name]["embeddings"] for name in "ABCD"] == ["-", "4", "-", "-"]
    assert {table[name]["fps"] for name in "ABCD"} == {"2.5"}
    assert "camera D saw no person" in out

    assert run(["check", str(scene), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["mode"], report["cameras"][1]["embedding_dimensions"]) == ("combined", 4)
    assert all(camera["shared"] == {} and camera["fps"] == 2.5 for camera in report["cameras"])

    # Frames 1, 3, 5 of a camera of twice the rate are the frames 1, 2, 3 of the other.
    files = {"A.txt": rows(5), "B.txt": rows(9, (2, 3))}
    scene = write_scene(tmp_path, files=files, extra="fps = 20\n[scene]\nfps = 10")
    assert run(["check", str(scene), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["cameras"][0]["shared"] == {"B": {"people": 1, "sightings": 5}}


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filmed")
    film(puppets(1.0, 10.0, 2, 1), folder)
    return folder


@pytest.mark.parametrize(("fps", "odd"), [(10.0, False), (9.96, False), (10.04, False), (9.9, True), (10.1, True)])
def test_another_rate_than_the_video_s_own_is_believed_and_reported(filmed, fps, odd):
    path = scene_file(filmed, {"C1": "C1.mp4", "C2": "C2.mp4"}, extra=f"[scene]\nfps = {fps}")
    found = read_camera(Scene.load(path), "C1").findings
    values = {"video_fps": 10.0, "fps": fps}
    assert [(one.code, one.cameras, values.items() <= one.values.items()) for one in found] == [
        ("video_rate_differs", ("C1",), True)
    ] * odd
