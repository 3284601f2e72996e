"""Pictures of simulated scenes show what the truth says."""

import tomllib
from dataclasses import replace
from unittest.mock import Mock

import av
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.core.cameras import Lens, Rig
from passerby.interchange.motchallenge import read_boxes
from passerby.simulation import write_scene
from passerby.simulation.body import JOINTS, BodyState, pose_joints
from passerby.simulation.observe import observe_camera
from passerby.simulation.rendering import RenderOptions, render_camera, write_videos
from passerby.simulation.rendering.background import World, background
from passerby.simulation.rendering.clothes import draw_outfits
from passerby.simulation.rendering.drawing import PeoplePainter, ShadowCaster
from passerby.simulation.rendering.mesh import template
from passerby.simulation.rendering.surroundings import SHADOW, Light
from support.scenes.simulated import scene

STILL = RenderOptions(noise=0.0, light_drift=0.0, blur_px=0.0)
NO_GRAIN = np.zeros((128, 128), dtype=np.float32)


def small(simulated, factor=0.5):
    cameras = []
    for camera in simulated.rig:
        matrix = np.diag((factor, factor, 1.0)) @ camera.lens.matrix
        size = tuple(int(side * factor) for side in camera.lens.size)
        cameras.append(replace(camera, lens=Lens(size, matrix, camera.lens.distortions)))
    return replace(simulated, rig=Rig(tuple(cameras)))


def standing(*places):
    """(1, P, J, 3) joints of people who stand at ground positions, and their heights."""
    shape = (1, len(places))
    zeros = {name: np.zeros(shape) for name in BodyState.__dataclass_fields__ if name != "xy"}
    heights = np.full(len(places), 1.75)
    return pose_joints(BodyState(xy=np.array([places], dtype=float), **zeros), heights), heights


def painter(camera, heights, clothes="individual", light=None):
    outfits = draw_outfits(clothes, len(heights), np.random.default_rng(4))
    return PeoplePainter(camera, heights, outfits, light or Light(np.array([0.0, 0.0, 1.0]), sunny=False), NO_GRAIN)


def blank(camera, level=0):
    return np.full((camera.lens.size[1], camera.lens.size[0], 3), level, dtype=np.uint8)


def edge(cover):
    """Where a profile of coverage begins, in pixels, to a part of a pixel."""
    first = np.flatnonzero(cover > 0.02)[0]
    return first - 0.5 + (1 - cover[first])


@pytest.mark.parametrize(("preset", "clothes"), [("terrace", "individual"), ("construction", "alike")])
def test_silhouettes_fill_the_true_boxes(preset, clothes):
    simulated = scene(preset=preset, seed=3, fps=0.5)
    camera = simulated.rig["C1"]
    heights = np.array(list(simulated.heights.values()))
    state, present = simulated.motion.at((simulated.frames - 1) / 0.5)
    joints = pose_joints(state, heights)
    true = observe_camera(camera, joints, heights, present)
    artist, off = painter(camera, heights, clothes), []
    for t in range(len(joints)):
        for surface in artist.surfaces(joints[t], present[t]):
            if true.clipped[t, surface.person].any():
                continue
            canvas = blank(camera)
            artist.paint(canvas, replace(surface, colours=np.full_like(surface.colours, 255.0)))
            across, down = canvas[..., 0].max(axis=0) / 255, canvas[..., 0].max(axis=1) / 255
            width, height = camera.lens.size
            drawn = edge(across), edge(down), width - 1 - edge(across[::-1]), height - 1 - edge(down[::-1])
            box = true.box[t, surface.person]
            off.append((np.array(drawn) - box) / (box[3] - box[1]))
    assert len(off) > 15
    assert np.abs(np.mean(off, axis=0)).max() < 0.01
    assert np.abs(np.mean(off, axis=0)[[1, 3]]).max() < 0.005
    assert np.std(off, axis=0).max() < 0.012


def test_a_near_person_hides_a_far_one():
    simulated = scene(seconds=1.0)
    camera = simulated.rig["C1"]
    towards = -camera.centre[:2] / np.linalg.norm(camera.centre[:2])
    places = camera.centre[:2] + 4 * towards, camera.centre[:2] + 7 * towards
    for near, far in ((0, 1), (1, 0)):
        joints, heights = standing(places[near], places[far])
        artist = painter(camera, heights)
        surfaces = artist.surfaces(joints[0], np.array([True, True]))
        assert [surface.person for surface in surfaces] == [far, near]
        together, alone = blank(camera), blank(camera)
        for surface in surfaces:
            artist.paint(together, surface)
        artist.paint(alone, surfaces[-1])
        shown = alone.any(axis=-1)
        solid = shown & (np.roll(shown, 2, 0) & np.roll(shown, -2, 0) & np.roll(shown, 2, 1) & np.roll(shown, -2, 1))
        np.testing.assert_array_equal(together[solid], alone[solid])
        assert (together.any(axis=-1) & ~shown).sum() > 0  # the far one's head over the near one's
    # A person behind the camera is not drawn.
    joints, heights = standing(1.5 * camera.centre[:2], camera.centre[:2])
    assert painter(camera, heights).surfaces(joints[0], np.array([True, True])) == []


def test_shadows_fall_away_from_the_sun():
    camera = scene(seconds=1.0).rig["C1"]
    joints, heights = standing((0.0, 0.0))
    chest = joints[0, 0, JOINTS.index("chest")]
    outfits = draw_outfits("alike", 1, np.random.default_rng(0))
    for azimuth in np.radians((10.0, 130.0, 250.0)):
        sun = np.array([np.cos(azimuth), np.sin(azimuth), 1.0]) / np.sqrt(2)
        flat = chest[2] / sun[2] * sun * (1, 1, 0)
        shadow, opposite = (np.round(camera.project(chest * (1, 1, 0) + way)[0]).astype(int) for way in (-flat, flat))
        sunny, dull = blank(camera, 200), blank(camera, 200)
        ShadowCaster(camera, heights, outfits, Light(sun, True)).cast(sunny, joints[0], np.array([True]))
        ShadowCaster(camera, heights, outfits, Light(sun, False)).cast(dull, joints[0], np.array([True]))
        assert sunny[shadow[1], shadow[0]] == pytest.approx(np.full(3, 200 * SHADOW), abs=12)  # its edge is soft
        assert (sunny[opposite[1], opposite[0]] == 200).all()
        assert (dull[shadow[1], shadow[0]] == 200).all()
        toe = np.round(camera.project(joints[0, 0, JOINTS.index("left_toe")] * (1, 1, 0))[0]).astype(int)
        assert dull[toe[1], toe[0]].max() < 185  # the contact shadow


@pytest.mark.slow
def test_the_same_scene_gives_the_same_pictures_whose_background_stands_still_but_for_noise():
    simulated = small(scene(seconds=1.0))
    first, second = (np.stack(list(render_camera(simulated, "C2", RenderOptions()))) for _ in range(2))
    assert first.shape == (5, 288, 360, 3)
    np.testing.assert_array_equal(first, second)
    other = next(render_camera(simulated, "C2", RenderOptions(clothes="alike")))
    assert (np.abs(other.astype(int) - first[0]).max(axis=-1) > 30).any()
    with pytest.raises(KeyError):
        render_camera(simulated, "C9", RenderOptions())
    still = np.stack(list(render_camera(simulated, "C1", STILL))).astype(int)
    fixed = (still == still[0]).all(axis=(0, 3))
    assert 0.6 < fixed.mean() < 1
    noisy = np.stack(list(render_camera(simulated, "C1", replace(STILL, noise=3.0)))).astype(int)
    calm = fixed & ((still[0] > 20) & (still[0] < 235)).all(axis=-1)
    error = (noisy - still)[:, calm]
    assert error.std() == pytest.approx(3.0, rel=0.1)
    assert abs(error.mean()) < 0.1
    assert (noisy[0] != noisy[1])[calm].mean() > 0.5


@pytest.mark.slow
def test_cameras_see_the_same_ground():
    rig = small(scene(seconds=1.0), 0.75).rig
    rng = np.random.default_rng(0)
    world = World.drawn("terrace", np.zeros(2), Light.drawn(True, rng), rng)
    places = np.column_stack([rng.uniform(-2.0, 2.0, (400, 2)), np.zeros(400)])
    seen = []
    for name in ("C1", "C3"):
        picture = background(rig[name], world).astype(float).sum(axis=-1)
        x, y = np.round(rig[name].project(places)).astype(int).T
        seen.append(picture[y, x])
    assert np.corrcoef(*seen)[0, 1] > 0.7
    assert abs(np.corrcoef(seen[0], np.roll(seen[1], 1))[0, 1]) < 0.2


def test_clothes_tell_people_apart_or_not():
    shape, camera = template(True), scene(seconds=1.0).rig["C1"]
    individual, alike = (
        painter(camera, np.full(12, 1.7), clothes)._wardrobes[True].colours for clothes in ("individual", "alike")
    )
    for part in ("trunk", "leg", "arm"):
        own, same = (colours[:, shape.faces(part)].mean(axis=1) for colours in (individual, alike))
        np.testing.assert_array_equal(same, np.broadcast_to(same[0], (12, 3)))
        assert np.ptp(own, axis=0).min() > 60
    assert np.ptp(alike[:, shape.faces("head")].mean(axis=1), axis=0).min() > 20


def test_videos_hold_the_scene(tmp_path):
    simulated = small(scene(seconds=1.0, cameras=2, camera_fps=(5.0, 8.0)))
    told = []
    paths = write_videos(simulated, tmp_path / "videos", STILL, tell=lambda *state: told.append(state))
    assert told[-1] == ("videos", 2, 2)
    for name, fps in (("C1", 5), ("C2", 8)):
        with av.open(str(paths[name])) as container:
            stream = container.streams.video[0]
            decoded = [frame.to_ndarray(format="bgr24") for frame in container.decode(stream)]
            assert stream.codec_context.name == "h264"
            assert stream.average_rate == fps
        assert len(decoded) == fps
        for picture, made in zip(decoded, render_camera(simulated, name, STILL), strict=True):
            assert picture.shape == (288, 360, 3)
            assert np.abs(picture.astype(int) - made).mean() < 6


@pytest.mark.slow
def test_a_scene_folder_with_videos(tmp_path):
    simulated = small(scene(seconds=0.6, cameras=2, people=4, unrelated_ids=True))
    path = write_scene(simulated, tmp_path / "s", video=RenderOptions(shadows=False))
    folder, declared = path.parent, tomllib.loads(path.read_text())
    assert declared["scene"] == {"name": "s"}
    assert declared["association"] == {"mode": "combined"}
    for name, table in declared["cameras"].items():
        assert table == {"intrinsics": "intrinsics.toml", "video": f"videos/{name}.mp4"}
        assert (folder / table["video"]).stat().st_size > 1000
        true = read_boxes(folder / "truth" / f"{name}.txt")
        assert set(true.identity.tolist()) <= set(simulated.heights)
    boxes = tomllib.loads((folder / "boxes.toml").read_text())
    assert boxes["scene"]["fps"] == 5.0
    assert boxes["cameras"]["C1"]["tracks"] == "tracks/C1.txt"
    assert tomllib.loads((folder / "simulation.toml").read_text())["video"]["shadows"] is False


def test_a_video_that_cannot_be_written_leaves_nothing_and_options_out_of_range_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("passerby.simulation.write.write_videos", Mock(side_effect=InputError("no space left")))
    with pytest.raises(InputError, match="no space"):
        write_scene(scene(seconds=1.0), tmp_path / "s", video=RenderOptions())
    assert list(tmp_path.iterdir()) == []
    out_of_range = {"clothes": "none"}, {"noise": -1.0}, {"noise": float("nan")}, {"light_drift": 0.5}, {"blur_px": 6.0}
    for change in out_of_range:
        with pytest.raises(InputError, match=next(iter(change))):
            RenderOptions(**change)
