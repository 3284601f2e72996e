"""CMC: cameras, people and boxes come out as they were put in; what is broken is told."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.io import savemat

from passerby.datasets import read_published
from support.datasets.cmc import write_cmc
from support.refusals import refused
from support.tiers import thinned


@pytest.mark.slow
@thinned(
    ("name", "left_handed", "scale", "matrices"),
    [("CMC1", False, 1.0, "mat"), ("CMC2", False, -0.3, "txt"), ("CMC3", True, 2.0, "mat"), ("CMC5", True, -1.0, "mat")],
    quick=2,
)
def test_cmc_is_what_was_put_in(tmp_path, name, left_handed, scale, matrices) -> None:
    walk = write_cmc(tmp_path / name, left_handed=left_handed, scale=scale, matrices=matrices)
    found = read_published("cmc", tmp_path / name)
    assert found.name == name.lower()
    assert found.fps == 4.0
    assert found.rig.names == walk.rig.names
    for camera, true in zip(found.rig, walk.rig, strict=True):
        assert camera.pose is not None
        assert true.pose is not None
        np.testing.assert_allclose(camera.lens.matrix, true.lens.matrix, atol=1e-6)
        np.testing.assert_allclose(camera.pose.R_cw, true.pose.R_cw, atol=1e-9)
        np.testing.assert_allclose(camera.centre, true.centre, atol=1e-8)
        boxes = found.boxes[camera.name]
        expected = {
            (frame + 1, person + 1): box
            for frame, here in enumerate(walk.positions)
            for person, xy in enumerate(here)
            if (box := walk.cylinder_box(true, xy, whole=True)) is not None
        }
        corners = np.hstack([boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]])
        keys = list(zip(boxes.frame.tolist(), boxes.identity.tolist(), strict=True))
        assert keys == sorted(expected)
        np.testing.assert_allclose(corners, [expected[key] for key in keys])
        assert found.frames_of_pictures(camera.name) == (1, 2)
    assert found.ground is not None
    np.testing.assert_allclose(found.ground.xy, walk.positions[found.ground.frame - 1, found.ground.identity - 1], atol=1e-5)
    assert any("left-handed" in note for note in found.notes) == left_handed


@pytest.fixture(scope="session")
def sound(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / "set"
    write_cmc(folder / "CMC1", matrices="txt")
    return folder


def line(path: Path, number: int, text: str) -> None:
    """Replace one line of a file, counted from 1."""
    lines = path.read_text().splitlines()
    lines[number - 1] = text
    path.write_text("\n".join(lines) + "\n")


BOXES, WORLD = "GT_CMC1_Cam2.txt", "GT_CMC1_WORLD_CENTROID.txt"
HDF5 = b"MATLAB 7.3 MAT-file, Platform: MACI64".ljust(116) + bytes(8) + b"\x00\x02IM" + bytes(400)


def matlab(folder: Path) -> Path:
    """The file of the first camera's matrix, which is MATLAB's now."""
    (folder / "cam1_cam_mat.txt").unlink()
    return folder / "cam1_cam_mat.mat"


BREAKS = {
    "MATLAB 7.3": (lambda f: matlab(f).write_bytes(HDF5), "cam1_cam_mat.mat: .*(install h5py, or save it as|cannot be read)"),
    "another shape": (lambda f: savemat(matlab(f), {"cam1_cam_mat": np.eye(3)}), r"has the shape \(3, 3\): a matrix of 3 x 4"),
    "no truth": (lambda f: (f / WORLD).unlink(), "no GT_CMC1_WORLD_CENTROID.txt"),
    "two sequences": (lambda f: shutil.copy(f / WORLD, f / "GT_CMC2_WORLD_CENTROID.txt"), "CMC1.* and GT_CMC2"),
    "no boxes": (lambda f: (f / BOXES).unlink(), f"{BOXES}: no such file"),
    "empty boxes": (lambda f: (f / BOXES).write_text(""), f"{BOXES}: is empty"),
    "a word": (lambda f: line(f / BOXES, 3, "1 2 a 4 5 6 1 -1 -1 -1"), f"{BOXES}: line 3 is .*numbers are needed"),
    "not finite": (lambda f: line(f / BOXES, 3, "1 2 nan 4 5 6 1 -1 -1 -1"), f"{BOXES}: line 3 is .*must be finite"),
    "too few columns": (lambda f: line(f / BOXES, 3, "1 2 3 4 5"), f"{BOXES}: line 3: has 5 columns"),
    "half a frame": (lambda f: line(f / BOXES, 3, "1.5 2 3 4 5 6 1 -1 -1 -1"), f"{BOXES}: line 3: frame and identity are 1.5"),
    "a flat box": (lambda f: line(f / BOXES, 1, "1 1 30 40 0 60 1 -1 -1 -1"), "the box of identity 1 in frame 1 is 0 x 60"),
    "twice": (lambda f: line(f / BOXES, 2, (f / BOXES).read_text().splitlines()[0]), "identity 1 occurs twice in frame"),
    "a centroid too few": (lambda f: line(f / WORLD, 2, "1 2 -1 -1 -1"), f"{WORLD}: line 2: has 5 columns"),
    "no matrix": (lambda f: (f / "cam3_cam_mat.txt").unlink(), "cam3_cam_mat.mat: no such file, and none in"),
    "a broken matrix": (lambda f: (f / "cam3_cam_mat.txt").write_text("1 2 3"), "cam3_cam_mat.txt: the matrix is .*3 rows"),
    "no camera": (lambda f: (f / "cam3_cam_mat.txt").write_text("0 0 0 1 " * 3), "cam3_cam_mat.txt: .*not a projection"),
    "another's matrix": (
        lambda f: shutil.copy(f / "cam1_cam_mat.txt", f / "cam3_cam_mat.txt"),
        "camera Cam_3 .*(of another recording|in front of it)",
    ),
    "small images": (lambda f: [shutil.copy(f / "tiny.png", p) for p in (f / "Cam_4").iterdir()], "is an image of 4 x 3"),
}  # fmt: skip


@pytest.mark.parametrize("what", sorted(BREAKS))
def test_what_is_broken_is_told_in_one_line(sound, tmp_path, what) -> None:
    shutil.copytree(sound, tmp_path / "set")
    folder = tmp_path / "set" / "CMC1"
    cv2.imwrite(str(folder / "tiny.png"), np.zeros((3, 4), np.uint8))
    spoil, message = BREAKS[what]
    spoil(folder)
    with refused(message, folder):
        read_published("cmc", folder)
