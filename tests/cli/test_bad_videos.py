"""Videos that cannot be used, through the command line: the exit status, and one line that tells what, where and the remedy."""

import itertools
import json

import cv2
import numpy as np
import pytest

from passerby.cli.main import run
from passerby.common import parallel
from sources.packaging import PACKAGINGS, pack
from support.scenes.puppet_videos import film, pictures, puppets, scene_file, wall, write_video
from support.tiers import thinned

BAD, DOUBTFUL = 2, 3


@pytest.fixture(scope="module")
def made():
    return puppets(12.0, 5.0, 2, 3)


@pytest.fixture(scope="module")
def good(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("good")
    film(made, folder)
    return folder


@pytest.fixture
def scene(good, tmp_path, monkeypatch):
    """A function that makes a scene file whose camera C1 has the video bad.mp4, or whatever the keywords say."""
    monkeypatch.setattr(parallel, "pays", lambda *measures: False)
    for path in good.iterdir():
        (tmp_path / path.name).symlink_to(path)

    def of(cameras=None, **options):
        return scene_file(tmp_path, cameras or {"C1": "bad.mp4", "C2": "C2.mp4"}, **options)

    return of


def refused(capsys, scene, command, *told):
    """The command ends with status 2 and one line that tells all this, and writes no result."""
    out = scene.parent / "out"
    assert run([command, str(scene), *(["-o", str(out)] if command == "calibrate" else [])]) == BAD
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("error: ")
    for part in told:
        assert part in line
    assert not [path for path in out.rglob("*") if path.is_file() and "perception" not in path.parts]
    assert not list(out.rglob("*.part"))
    return line


def without_index(content):
    """An MP4 as a recorder leaves it whose battery ran out: `ftyp` and `mdat`, but no `moov`."""
    found, place = b"", 0
    while place < len(content):
        length = int.from_bytes(content[place : place + 4], "big")
        found += content[place : place + length] if content[place + 4 : place + 8] != b"moov" else b""
        place += length
    return found


def still(count=60, size=(360, 288), seed=1):
    return (wall(size, seed) for _ in range(count))


def holding(content):
    return lambda folder, good: (folder / "bad.mp4").write_bytes(content(good))


def showing(change, count=60):
    return lambda folder, good: write_video(folder / "bad.mp4", (change(picture) for picture in still(count)), 5.0)


def pieces_and_images(folder, good):
    for place in ("pieces", "none", "stills", "both"):
        (folder / place).mkdir(parents=True)
    for path in ("pieces/000.mp4", "pieces/001.mp4", "both/000.mp4"):
        (folder / path).symlink_to(good / "C1.mp4")
    for path in ("stills/000001.png", "stills/000002.png", "both/000001.png"):
        cv2.imwrite(str(folder / path), np.zeros((48, 64, 3), np.uint8))


def as_a_phone_stores_it(folder, good):
    rotated = next(packaging for packaging in PACKAGINGS if packaging.rotation == 90)
    upright = [cv2.rotate(picture, cv2.ROTATE_90_CLOCKWISE) for picture in still()]
    pack(rotated, upright, len(upright), 5.0, folder, "bad")


UNREADABLE = {
    "empty": (holding(lambda good: b""), "bad.mp4", "holds 0 bytes: copy the video again"),
    "text": (holding(lambda good: b"a letter to a friend\n" * 500), "bad.mp4", "is not a video that can be read"),
    "noise": (holding(lambda good: np.random.default_rng(0).bytes(50_000)), "bad.mp4", "is not a video that can be read"),
    "codec": (holding(lambda good: (good / "C1.mp4").read_bytes().replace(b"avc1", b"xyz9")), "bad.mp4",
              "its video codec is unknown and cannot be decoded: convert it"),
    "no index": (holding(lambda good: without_index((good / "C1.mp4").read_bytes())), "bad.mp4",
                 "cut off before its index (moov) was written"),
    "missing": (lambda folder, good: None, "bad.mp4", "no such file: a video is needed here; check the path"),
    "folder": (lambda folder, good: (folder / "bad.mp4").mkdir(), "bad.mp4", "no video and no image is there"),
    "pattern": (pieces_and_images, "pieces/00[78].mp4", "no video and no image matches this pattern"),
    "images": (pieces_and_images, "stills", "has 2 numbered images, and their rate is not known: set fps"),
    "numbered": (pieces_and_images, "stills/%06d.png", "has 2 numbered images, and their rate is not known: set fps"),
    "one image": (pieces_and_images, "stills/000001.png", "is a single image: name the folder of all images"),
    "nothing": (pieces_and_images, "none", "no video and no image is there"),
    "both": (pieces_and_images, "both", "holds 1 videos (000.mp4, ...) and 1 images (000001.png, ...): name one kind"),
}  # fmt: skip


@pytest.mark.parametrize("command", ["calibrate", "check"])
@pytest.mark.parametrize("what", UNREADABLE)
def test_a_file_that_is_no_video_is_named(scene, good, tmp_path, capsys, command, what):
    make, video, told = UNREADABLE[what]
    make(tmp_path, good)
    path = scene({"C1": video, "C2": "C2.mp4"})
    refused(capsys, path, command, f"error: {tmp_path}/{video}: ", told, "(the video of camera C1)")


OF_LENS = ", its intrinsics are for 360 x 288"
UNFIT = {
    "scaled": (showing(lambda picture: cv2.resize(picture, (180, 144))), {},
               f"bad.mp4: camera C1: its frames are 180 x 144{OF_LENS}",
               "the video is scaled by 0.5; multiply the image size", "rig.toml, [C1])"),
    "turned": (showing(lambda picture: cv2.rotate(picture, cv2.ROTATE_90_CLOCKWISE)), {}, f"288 x 360{OF_LENS}",
               "the video is rotated by 90 degrees"),
    "cut": (showing(lambda picture: picture[:, :200]), {}, f"200 x 288{OF_LENS}", "give the intrinsics of this video"),
    "phone": (as_a_phone_stores_it, {"C1": "bad.MOV"}, f"bad.MOV: camera C1: its frames are 288 x 360{OF_LENS}",
              "the file's metadata rotate its frames by 90 degrees", "rig.toml, [C1])"),
    "copy": (holding(lambda good: (good / "C2.mp4").read_bytes()), {}, "scene.toml: [cameras.C2] video C2.mp4",
             "has the same content as bad.mp4 of camera C1: ", "give each camera its own"),
    "short": (showing(lambda picture: picture, 11), {}, "bad.mp4: camera C1: the video is 2.2 s long, that of camera C2 12.0 s",
              "was it cut short?"),
    "linked": (lambda folder, good: (folder / "link.mp4").symlink_to(folder / "C2.mp4"), {"C1": "C2.mp4", "C2": "link.mp4"},
               "scene.toml: [cameras.C2] video link.mp4 is camera C1's too: give each camera its own"),
}  # fmt: skip


@pytest.mark.parametrize("command", ["calibrate", "check"])
@pytest.mark.parametrize("what", UNFIT)
def test_a_video_that_does_not_fit_its_scene(scene, good, tmp_path, capsys, command, what):
    make, cameras, *told = UNFIT[what]
    make(tmp_path, good)
    refused(capsys, scene({"C1": "bad.mp4", "C2": "C2.mp4"} | cameras), command, f"error: {tmp_path}/", *told)


@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_a_video_gives_no_identities_and_three_frames_are_too_few(scene, made, tmp_path, capsys, command):
    path = scene({"C1": "C1.mp4", "C2": "C2.mp4"}, extra='[association]\nmode = "given"')
    refused(capsys, path, command, f"{path}: [cameras.C1]: has only a video", 'under [association] set mode = "combined"')
    if command == "calibrate":
        for name in ("C1", "C2"):
            write_video(tmp_path / f"three{name}.mp4", itertools.islice(pictures(made, name), 3), 5.0)
        path = scene({"C1": "threeC1.mp4", "C2": "threeC2.mp4"})
        refused(capsys, path, command, "threeC1.mp4: 3 frames are too few", "give a recording with 5 or more", "camera C1",
                "(and 1 more fault)")  # fmt: skip


@pytest.mark.slow
@thinned("suffix", [".mp4", ".mkv"])
def test_a_video_that_was_cut_off(scene, good, made, tmp_path, capsys, suffix):
    bad = tmp_path / f"bad{suffix}"
    source = good / "C1.mp4" if suffix == ".mp4" else write_video(tmp_path / "whole.mkv", pictures(made, "C1"), 5.0)
    bad.write_bytes(source.read_bytes()[: source.stat().st_size * 3 // 5])
    path = scene({"C1": bad.name, "C2": "C2.mp4"})
    told = (
        f"{bad}: camera C1: the video ends after ",
        " s of the 12.0 s that the file states: it was cut off: copy the video",
    )
    first = refused(capsys, path, "calibrate", *told)
    # The other camera's results are kept, and the same is told from those of the broken one.
    assert list((tmp_path / "out" / "perception" / "C2").glob("people-*"))
    assert refused(capsys, path, "calibrate", *told) == first


@pytest.mark.slow
def test_a_camera_that_moves(scene, tmp_path, capsys):
    fine = np.random.default_rng(5).normal(128, 60, (80, 100, 3)).clip(0, 255).astype(np.uint8)
    wide = cv2.resize(fine, (500, 400), interpolation=cv2.INTER_LINEAR)
    moved = (wide[50:338, left : left + 360].copy() for left in [40] * 30 + [75] * 30)
    write_video(tmp_path / "bad.mp4", moved, 5.0)
    line = refused(
        capsys, scene(), "calibrate", f"{tmp_path}/bad.mp4: camera C1: the camera moves ",
        "and stays there: static cameras are needed", "delete [cameras.C1]",
    )  # fmt: skip
    assert 6.0 <= float(line.split("the camera moves ")[1].split()[0]) <= 7.6


@pytest.mark.slow
def test_videos_without_people_are_an_error(scene, tmp_path, capsys):
    for seed, name in enumerate(("C1", "C2"), start=1):
        write_video(tmp_path / f"empty{name}.mp4", still(seed=seed), 5.0)
    path = scene({"C1": "emptyC1.mp4", "C2": "emptyC2.mp4"})
    refused(capsys, path, "calibrate", f"{path}: no camera saw anybody: no person was detected in their videos")
    run(["check", str(path)])
    assert not capsys.readouterr().err, "check does not watch videos"


@pytest.mark.slow
def test_a_video_without_people_leaves_its_camera_out(scene, good, tmp_path, capsys):
    rig = (good / "rig.toml").read_text()
    third = rig[rig.index("[C2]") :].replace("[C2]", "[C3]").replace('"C2"', '"C3"').replace("[C2.", "[C3.")
    (tmp_path / "third.toml").write_text(third.partition("[metadata]")[0])
    write_video(tmp_path / "empty.mp4", still(), 5.0)
    cameras = {name: f'detections = "{name}.txt"' for name in ("C1", "C2")} | {"C3": "empty.mp4"}
    path = scene_file(tmp_path, cameras, extra="\n[scene]\nfps = 5\n[association]\nmax_offset_s = 0")
    own = '[cameras.C3]\nintrinsics = "{}.toml"'
    path.write_text(path.read_text().replace(own.format("rig"), own.format("third")))
    assert run(["calibrate", str(path), "-o", str(tmp_path / "out"), "--json"]) in (0, DOUBTFUL)
    told = json.loads(capsys.readouterr().out)
    assert [camera["registered"] for camera in told["cameras"]] == [True, True, False]
    said = "camera C3 saw no person: no person was detected in its video, so it cannot be calibrated"
    assert any(said in note for note in told["findings"])


@pytest.mark.parametrize(
    ("rows", "status", "told"),
    [
        (8, 0, "its video frames are 360 x 280, the image size of its intrinsics is 360 x 288: the codec is assumed"),
        (16, BAD, "360 x 272"),
    ],
)
def test_rows_that_a_codec_cuts_off_are_a_note(scene, tmp_path, capsys, rows, status, told):
    """1080 rows of a lens for 1088 are usual; 16 rows, a whole block, are not."""
    write_video(tmp_path / "bad.mp4", (picture[:-rows] for picture in still()), 5.0)
    assert run(["check", str(scene())]) == status
    printed = capsys.readouterr()
    assert told in (printed.err if status else printed.out)
    assert "note: " in printed.out or status


@pytest.mark.parametrize(
    ("detector", "told"),
    [
        ("yolox-nan", "yolox-nan: is not a model that Passerby knows: there are yolox-nano"),
        ("x.onnx", "x.onnx: no such file: the path of an .onnx file is needed for the detector"),
        ("C1.txt.onnx", "C1.txt.onnx: this is not an ONNX file"),
    ],
)
@pytest.mark.parametrize("command", ["calibrate", "check"])
def test_a_network_that_cannot_be_used(scene, tmp_path, capsys, command, detector, told):
    (tmp_path / "C1.txt.onnx").write_text("1,1,2,3")
    path = scene({"C1": "C1.mp4", "C2": "C2.mp4"}, perception=f'detector = "{detector}"\nembedder = "stripes"')
    refused(capsys, path, command, f"error: {path}: [perception] detector = ", told)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("inside", [True, False])
def test_an_output_folder_that_cannot_be_one(scene, tmp_path, capsys, inside):
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out" if inside else tmp_path / "file"
    assert run(["calibrate", str(scene({"C1": "C1.mp4", "C2": "C2.mp4"})), "-o", str(out)]) == BAD
    (line,) = capsys.readouterr().err.splitlines()
    assert "cannot be written" in line
    assert "choose a folder that you may write to" in line


def test_check_shows_videos_and_what_is_to_be_fetched(scene, tmp_path, capsys, monkeypatch):
    path = scene({"C1": "C1.mp4", "C2": 'detections = "C2.txt"\nfps = 5'})
    assert run(["check", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert " ".join(lines[2].split()) == "C1 360x288 h264 360x288 5 fps 12.0 s - - - - video - 5 ok"
    assert lines[3].split()[:4] == ["C2", "360x288", "-", "-"]
    assert lines[4] == "from the videos: people by background, appearance by stripes"
    assert lines[-1] == "no problems found"
    assert run(["check", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["perception"] == {"detector": "background", "embedder": "stripes"}
    assert told["cameras"][0]["video"] == {
        "file": str(path.parent / "C1.mp4"), "size": [360, 288], "codec": "h264", "fps": 5.0, "variable": False, "pictures": 60,
        "seconds": 12.0, "watched": True,
    }  # fmt: skip
    assert "video" not in told["cameras"][1]

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("PASSERBY_MODELS", raising=False)
    assert run(["check", str(scene({"C1": "C1.mp4", "C2": "C2.mp4"}, perception='detector = "auto"\nembedder = "none"'))]) == 0
    out = capsys.readouterr().out
    assert "from the videos: people by yolox-nano, keypoints by rtmpose-m-halpe26\n" in out
    assert "note: yolox-nano is not on this computer: `passerby models fetch` downloads it" in out

    # Networks are looked for only where a video needs them.
    cameras = {name: f'detections = "{name}.txt"\nfps = 5' for name in ("C1", "C2")}
    assert run(["check", str(scene(cameras, perception='detector = "nowhere.onnx"'))]) == 0
    assert "from the videos" not in capsys.readouterr().out
