"""Every format that is written and read: points stay at their pixels, or it is stated how far they are off."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Camera, Lens, Pose, Rig
from passerby.interchange.formats import Export, Given, all_formats, export, read_rig_as
from passerby.interchange.formats import lens_models as lm
from passerby.interchange.formats.format import Losses
from support.scenes.handmade_rigs import NASTY_NAMES, facing, read_back, written
from support.scenes.rigs_to_draw import ways
from support.tiers import thinned

SIZE = (1280, 720)
NAMES = ("Hall 1.north", "C-2")
TOLERANCE_PX = 1e-6
RADTAN = (-0.21, 0.06, 0.0012, -0.0017)
RATIONAL = (*RADTAN, 0.01, 0.021, -0.012, 0.004)
PRISM = (*RATIONAL, 0.0011, -0.0006, 0.0008, 0.0003)
BENT_FISHEYE = (0.031, -0.012, 0.0021, -0.0004)
KINDS = {
    "pinhole": (), "radtan 4": RADTAN, "radtan 5": (*RADTAN, -0.009), "rational 8": RATIONAL, "prism 12": PRISM,
    "tilted 14": (*PRISM, 0.013, -0.021), "fisheye": BENT_FISHEYE, "skewed": (), "skewed radtan 4": RADTAN,
    "skewed rational 8": RATIONAL, "skewed fisheye": BENT_FISHEYE, "estimated": (-0.12, 0.0, 0.0, 0.0),
    "estimated wide": (-0.3, 0.0, 0.0, 0.0), "estimated fisheye": (0.03, 0.0, 0.0, 0.0),
}  # fmt: skip
"""Distortion of the lenses. Estimated ones are as people give them: one focal length, one coefficient, which turns over within
the picture where the lens is wide."""
SKEWS = {"skewed": 2.5, "skewed radtan 4": 30.0, "skewed rational 8": 0.4, "skewed fisheye": 5.0}
"""Of the camera matrix, pixels; of the others 0."""
ESTIMATED = {"estimated", "estimated wide"}
FISHEYES = {"fisheye", "estimated fisheye"}
RADTANS = {"pinhole", "radtan 4", "radtan 5", *ESTIMATED}
UP_TO_8 = {*RADTANS, "rational 8", *FISHEYES}
ALL_BUT_SKEW = {*UP_TO_8, "prism 12", "tilted 14"}
HOLDS = {
    "colmap": UP_TO_8, "colmap-bin": UP_TO_8, "opencv": {*ALL_BUT_SKEW, "skewed fisheye"}, "anipose": ALL_BUT_SKEW,
    "pose2sim": ALL_BUT_SKEW - FISHEYES, "caliscope": ALL_BUT_SKEW, "freemocap": ALL_BUT_SKEW, "easymocap": RADTANS,
    "kalibr": {"pinhole", "radtan 4", *ESTIMATED, *FISHEYES}, "ros": UP_TO_8, "nerfstudio": {*RADTANS, *FISHEYES},
    "mv3dt": {*RADTANS, "skewed"}, "amc": {"pinhole", "skewed"}, "krt-json": RADTANS, "panoptic": RADTANS,
}  # fmt: skip
"""Which lenses each format holds as they are."""
KEEPS_UNPOSED = {"opencv", "caliscope", "ros"}
RENAMES = {"colmap", "colmap-bin", "opencv"}
"""Where a camera may have another name afterwards; the others keep every name."""
ROUND_TRIPS = {form.name: form for form in all_formats() if form.write and form.read}
FORMATS = sorted(ROUND_TRIPS)
WRITTEN = {form.name: form for form in all_formats() if form.write and form.name != "rerun"}


def lens(kind, rng):
    """A lens of a kind, its numbers a little different each time."""
    fisheye = "fisheye" in kind
    focal = rng.uniform(420, 480) if fisheye else rng.uniform(850, 1100)
    focal *= 0.58 if kind == "estimated wide" else 1.0
    ratio = 1.0 if kind.startswith("estimated") else 1.004
    matrix = np.array([[focal, 0, 655.3], [0, focal * ratio, 349.8], [0, 0, 1.0]])
    matrix[:2, 2] += rng.uniform(-9, 9, 2)
    matrix[0, 1] = SKEWS.get(kind, 0.0)
    return Lens(SIZE, matrix, np.array(KINDS[kind]) * rng.uniform(0.9, 1.1, len(KINDS[kind])), fisheye)


def pose(rng):
    """A camera that stands some metres off and looks about the middle of the world, a little rolled."""
    turn = rng.uniform(0, 2 * np.pi)
    centre = np.array([9 * np.cos(turn), 9 * np.sin(turn), rng.uniform(2.5, 5)])
    ahead = -centre / np.linalg.norm(centre)
    right = np.cross(ahead, (0, 0, 1.0))
    right /= np.linalg.norm(right)
    looking = np.array([right, np.cross(ahead, right), ahead])
    return Pose.from_centre(cv2.Rodrigues(rng.normal(0, 0.08, 3))[0] @ looking, centre)


@cache
def rig_of(kind, seed=5, names=NAMES):
    rng = np.random.default_rng(seed)
    return Rig(tuple(Camera(name, lens(kind, rng), pose(rng)) for name in names))


@cache
def seen_points(camera, widest_deg):
    """World points all over a camera's picture and along its border, where its own lens has one ray for each pixel."""
    rng = np.random.default_rng(11)
    angle, turn = np.radians(rng.uniform(0, widest_deg, 1500)), rng.uniform(0, 2 * np.pi, 1500)
    rays = np.column_stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
    share = np.linspace(0, 1, 60)
    border = [np.column_stack([share, np.full(60, side)]) for side in (0, 1)]
    border = np.vstack([*border, *(edge[:, ::-1] for edge in border)]) * (np.array(SIZE) - 1)
    rim = np.radians(widest_deg)
    rim = np.column_stack([np.sin(rim) * np.cos(turn), np.sin(rim) * np.sin(turn), np.full(len(turn), np.cos(rim))])
    rays = np.vstack([rays, rim, camera.lens.bearings(border)])
    pixels = camera.lens.project_rays(rays)
    keep = (pixels > -0.4).all(axis=1) & (pixels < np.array(SIZE) - 0.6).all(axis=1)
    keep &= (camera.lens.bearings(pixels) * rays).sum(axis=1) > 1 - 1e-9
    keep &= rays[:, 2] >= np.cos(np.radians(widest_deg)) - 1e-12
    depth = rng.uniform(1, 30, (len(rays), 1))
    return ((rays * depth)[keep] - camera.pose.t_cw) @ camera.pose.R_cw


def counterpart(camera, rig, back):
    """The same camera in what was read back: of the same name, or where names had to change in the same place."""
    return back[camera.name] if camera.name in back.names else back.cameras[rig.names.index(camera.name)]


def largest_difference(camera, other, widest_deg=85.0):
    points = seen_points(camera, widest_deg)
    assert len(points) > 500
    return np.linalg.norm(camera.project(points) - other.project(points), axis=1).max()


def target(name, folder):
    form = WRITTEN[name]
    return folder / ("rig" + form.suffixes[0] if form.target == "file" else "rig")


def there_and_back(name, rig, folder, lossy=False):
    told = export(Export(rig, "a scene"), name, target(name, folder), lossy=lossy)
    given = Given(SIZE)
    back, _ = read_rig_as(name, target(name, folder), given)
    assert given.unread.told == ()
    return back, told


HELD = [(name, kind) for name in FORMATS for kind in KINDS if kind in HOLDS.get(name, ())]
LOST = [(name, kind) for name in FORMATS for kind in KINDS if kind not in HOLDS.get(name, ())]


@thinned(("name", "kind"), HELD, every=3)
def test_points_stay_at_their_pixels(name, kind, tmp_path):
    rig = rig_of(kind)
    back, told = there_and_back(name, rig, tmp_path)
    assert told == ()
    assert len(back) == len(rig)
    for camera in rig:
        other = counterpart(camera, rig, back)
        assert other.lens.size == SIZE
        assert largest_difference(camera, other) < TOLERANCE_PX


@thinned(("name", "kind"), LOST, every=5)
def test_what_a_loss_says_is_true(name, kind, tmp_path):
    rig = rig_of(kind)
    back, told = there_and_back(name, rig, tmp_path, lossy=True)
    for camera in rig:
        other = counterpart(camera, rig, back)
        said = next(line for line in told if line.startswith(f"camera {camera.name}: "))
        stated = float(re.search(r"up to ([\d.e+-]+) px off", said)[1])
        # Of a fisheye as a pinhole only what is within 80 degrees of the axis is told of.
        found = largest_difference(camera, other, widest_deg=80.0)
        assert 0.7 * stated < found <= stated


@pytest.mark.parametrize(("name", "kind"), list({name: (name, kind) for name, kind in LOST}.values()))
def test_a_loss_is_an_error(name, kind, tmp_path):
    rig = rig_of(kind)
    with pytest.raises(InputError, match="--lossy") as refused:
        export(Export(rig), name, target(name, tmp_path))
    assert all(f"camera {camera.name}: its lens" in str(refused.value) for camera in rig)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", sorted(WRITTEN.keys() - {"frigate"}))
def test_a_camera_without_a_pose(name, tmp_path):
    posed = rig_of("pinhole")
    rig = Rig((*posed, Camera("later", lens("pinhole", np.random.default_rng(3)))))
    if name in KEEPS_UNPOSED:
        back, told = there_and_back(name, rig, tmp_path)
        later = counterpart(rig["later"], rig, back)
        rays = np.random.default_rng(4).uniform((-0.5, -0.3, 1), (0.5, 0.3, 1), (50, 3))
        assert told == ()
        assert later.pose is None
        np.testing.assert_allclose(later.lens.project_rays(rays), rig["later"].lens.project_rays(rays), atol=TOLERANCE_PX)
        return
    with pytest.raises(InputError, match=r"camera later has no pose.*--lossy"):
        export(Export(rig), name, target(name, tmp_path))
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match="none of the 1 cameras has a pose"):
        export(Export(Rig((rig["later"],))), name, target(name, tmp_path), lossy=True)
    assert "camera later has no pose and is left out" in export(Export(rig), name, target(name, tmp_path), lossy=True)
    if name in ROUND_TRIPS:
        back, _ = read_rig_as(name, target(name, tmp_path), Given(SIZE))
        assert len(back) == 2
        assert max(largest_difference(camera, counterpart(camera, posed, back)) for camera in posed) < TOLERANCE_PX


@pytest.mark.parametrize("name", sorted(KEEPS_UNPOSED))
def test_a_guess_is_not_handed_over_as_intrinsics(name, tmp_path):
    posed = rig_of("estimated")
    later = Camera("later", Lens.unknown(SIZE))
    with pytest.raises(InputError, match=r"camera later has neither a pose nor known intrinsics.*--lossy"):
        export(Export(Rig((*posed, later))), name, target(name, tmp_path))
    back, told = there_and_back(name, Rig((*posed, later)), tmp_path, lossy=True)
    assert told == ("camera later has neither a pose nor known intrinsics and is left out",)
    assert len(back) == len(posed)
    with pytest.raises(InputError, match="nothing to export"):
        export(Export(Rig((later,))), name, target(name, tmp_path))
    stated = Rig((*posed, Camera("later", Lens.unknown(SIZE, hfov_deg=80.0))))
    assert len(there_and_back(name, stated, tmp_path / "stated")[0]) == len(posed) + 1


ODD_NAMES = (
    "true", "metadata", "cam 1", "cam_1", "Überblick", "../up", 'a"b<c>&', "#1: x", "it's", "7", *NASTY_NAMES,
    "</cameras><x>&y;", '"]\n[metadata]\nunits = "mm', "a: !!python/name:os.system", "$(id);`id`", "--help",
)  # fmt: skip


@pytest.mark.parametrize("name", FORMATS)
def test_odd_names(name, tmp_path):
    rig = rig_of("pinhole", names=ODD_NAMES)
    inside = tmp_path / "below" / "below"
    back, told = there_and_back(name, rig, inside)
    assert (told, len(back)) == ((), len(rig))
    assert all(inside in path.parents for path in tmp_path.rglob("*") if path.is_file())
    for camera in rig:
        nearest = min(back, key=lambda other: np.linalg.norm(other.centre - camera.centre))
        assert largest_difference(camera, nearest) < TOLERANCE_PX
        assert nearest.name == camera.name or name in RENAMES or camera.name == "null"  # Caliscope's word for none
        assert nearest.name == camera.name or camera.name not in back.names


@pytest.mark.parametrize("name", sorted(WRITTEN.keys() - {"frigate"}))
def test_a_rig_makes_one_set_of_files_below_its_target(name, tmp_path):
    rig, people = rig_of("radtan 4", names=ODD_NAMES), ways()
    first, again = (WRITTEN[name].write(Export(rig, "</x>../../y", people), Losses()) for _ in range(2))
    assert first == again
    assert all(not Path(below).is_absolute() and ".." not in Path(below).parts for below in first)


@pytest.mark.parametrize("name", FORMATS)
def test_lengths_are_in_the_given_unit(name, tmp_path):
    written(name, Rig((facing(),)), target(name, tmp_path))
    places = [read_back(name, target(name, tmp_path), metres_per_unit=unit, size=(1920, 1080))[0] for unit in (1.0, 0.5)]
    (one,), (half,) = places
    np.testing.assert_allclose(half.centre, one.centre / 2, atol=1e-9)


MATRIX = np.array([[900.0, 0, 652], [0, 911, 349], [0, 0, 1]])
SKEWED = MATRIX + np.array([[0, 30.0, 0], [0, 0, 0], [0, 0, 0]])


def lens_with(*coefficients, matrix=MATRIX, fisheye=False):
    return Lens(SIZE, matrix, np.array(coefficients), fisheye)


def largest_error(lens, other):
    """Over four times as many pixels across and down as a fit looks at."""
    across, down = (np.linspace(-0.5, length - 0.5, n) for length, n in zip(SIZE, (164, 124), strict=True))
    rays = lens.bearings(np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2))
    known = np.isfinite(rays).all(axis=1)
    if not other.fisheye:
        known &= rays[:, 2] >= np.cos(np.radians(80.0))
    return np.linalg.norm(other.project_rays(rays[known]) - lens.project_rays(rays[known]), axis=1).max()


@thinned("seed", range(6))
@pytest.mark.parametrize("model", [lm.PINHOLE, lm.RADTAN_5, lm.RATIONAL_8, replace(lm.RADTAN_4, one_focal=True, centred=True)])
def test_the_stated_error_is_true_of_any_lens(seed, model):
    rng = np.random.default_rng(seed)
    skewed = MATRIX + np.array([[0, rng.uniform(1, 4), 0], [0, 0, 0], [0, 0, 0]])
    fisheye = np.diag([0.5, 0.5, 1]) @ MATRIX + np.array([[0, 0, 320], [0, 0, 175], [0, 0, 0]])
    for lens in (
        lens_with(matrix=skewed),
        lens_with(*np.array(RATIONAL) * rng.uniform(0.7, 1.3, 8), *rng.normal(0, 0.001, 4), *rng.normal(0, 0.02, 2)),
        lens_with(*rng.normal(0, (0.02, 0.01, 0.003, 0.001)), fisheye=True, matrix=fisheye),
    ):
        losses = Losses()
        found, _ = lm.express_lens(Camera("C", lens), (model,), losses)
        stated = float(re.search(r"up to ([\d.e+-]+) px off", losses.told[0])[1])
        assert largest_error(lens, found) <= stated
        if model.one_focal:
            assert found.matrix[0, 0] == found.matrix[1, 1]
            assert found.matrix[:2, 2].tolist() == [639.5, 359.5]


@pytest.mark.parametrize(
    "model", [lm.RADTAN_5, replace(lm.PRISM_12, centred=True), replace(lm.TILTED_14, skew=True, one_focal=True)]
)
def test_derivatives_are_those_of_differences(model):
    lens = lm._drop_unsupported(
        lens_with(*RATIONAL, 1e-3, -1e-3, 5e-4, 2e-4, 0.01, -0.02, matrix=SKEWED),
        model,
    )
    rays = np.random.default_rng(1).uniform((-0.6, -0.35, 1), (0.6, 0.35, 1.2), (30, 3))
    numbers = lm._numbers(lens, model)
    found = lm._slopes(lens, model, rays)
    assert found.shape == (60, numbers.size)
    for index, number in enumerate(numbers):
        step = np.zeros(numbers.size)
        step[index] = 1e-6 * max(1.0, abs(number))
        ahead, behind = (lm._lens(lens, model, numbers + sign * step).project_rays(rays).ravel() for sign in (1, -1))
        difference = (ahead - behind) / (2 * step[index])
        np.testing.assert_allclose(found[:, index], difference, atol=1e-4 * np.abs(difference).max())


def test_a_fit_that_fails_is_no_lens(monkeypatch):
    """Another model is tried then, or the caller reports the error."""

    def broken(*arguments, **named):
        raise np.linalg.LinAlgError("SVD did not converge")

    rays = lm.Rays.of(lens_with(*RATIONAL))
    assert lm.fit_lens_model(rays, lm.RADTAN_5, lens_with()) is not None
    monkeypatch.setattr(lm, "least_squares", broken)
    assert lm.fit_lens_model(rays, lm.RADTAN_5, lens_with()) is None


def test_a_lens_without_any_ray_is_an_error():
    with pytest.raises(InputError, match=r"camera C: its lens .* cannot even be fitted"):
        lm.express_lens(Camera("C", lens_with(-3.0, 0, 0, 0, matrix=np.diag([30.0, 30, 1]))), (lm.PINHOLE,), Losses())


@pytest.mark.parametrize(("pixels", "stated"), [(0.0123, "0.013"), (1.0, "1.1"), (123.4, "130"), (9.85, "10"), (0, "1e-09")])
def test_stated_errors_are_rounded_up(pixels, stated):
    assert lm._round_up(pixels) == stated
