"""People held out of the adjustment: what is held out, and what they say of a rig."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.held_out import EVERY, hold_out, is_held_out
from passerby.core.cameras import Rig
from passerby.core.figures import HeldOutFigures
from passerby.core.observations import CameraObservations
from passerby.people.one_against_others import disagreements
from passerby.simulation import SimulationOptions, simulate

HEIGHT_M = 1.72


@pytest.fixture(scope="module")
def scene():
    return simulate(SimulationOptions(preset="terrace", seed=950, seconds=25.0, box_noise=0.01))


def figures_of(rig, instants, seed=0) -> HeldOutFigures:
    found = hold_out(rig, instants, HEIGHT_M, seed)
    assert found.figures is not None
    return found.figures


def ratio(figures: HeldOutFigures) -> float:
    """How many times as much as fitted people those of the best stretch held out disagree, as a share of their size."""
    return figures.least_share / figures.fit.median_share


def test_a_good_rig_fits_people_whom_it_never_saw(scene):
    figures = figures_of(scene.rig, scene.observations)
    assert figures.stretches == 1
    assert figures.stretch_s == pytest.approx(5.0, abs=0.1)
    assert figures.fit.sightings > 3 * figures.held_out.sightings
    assert 0.6 < ratio(figures) < 1.5
    assert 0.02 < figures.held_out.ground_50_m < 0.4
    assert figures.held_out.ground_50_m < figures.held_out.ground_90_m


@pytest.mark.slow
def test_a_camera_that_was_elsewhere_in_the_stretch_held_out(scene):
    """The rest of the recording cannot show it: only the people held out do."""
    rig, instants = scene.rig, scene.observations
    good = figures_of(rig, instants)
    seen = instants["C2"]
    ltwh = seen.boxes.ltwh.copy()
    rows = is_held_out(seen.boxes.frame, rig, instants, good.stretch_s)
    assert 0.1 < rows.mean() < 0.3
    ltwh[rows, 0] += 0.5 * ltwh[rows, 3]
    bumped = replace(instants, cameras={**instants.cameras, "C2": CameraObservations(replace(seen.boxes, ltwh=ltwh))})
    figures = figures_of(rig, bumped)
    assert figures.fit.median_px == pytest.approx(good.fit.median_px, rel=0.1)
    assert ratio(figures) > 1.5 * ratio(good)


def test_two_cameras_hold_people_out_of_each_other(scene):
    for count in (1, 2):
        rig = Rig(scene.rig.cameras[:count])
        boxes = {name: scene.observations[name].boxes for name in rig.names}
        early = {name: CameraObservations(one.take(one.frame < 60)) for name, one in boxes.items()}
        seen = replace(scene.observations, cameras=early)
        found = hold_out(rig, seen, HEIGHT_M, 0)
        assert (found is not None) == (count == 2)
    assert 0.5 < ratio(found.figures) < 1.6


def test_every_fifth_stretch_and_no_other(scene):
    steps = np.arange(1, 26 * 10)
    held = is_held_out(steps, scene.rig, scene.observations, 1.0)
    fps = scene.observations.fps
    number = (steps - steps[held][0]) // fps
    assert (held == (number % EVERY == 0)).all()


@pytest.mark.slow
def test_the_same_seed_gives_the_same_figures(scene):
    assert figures_of(scene.rig, scene.observations, 3) == figures_of(scene.rig, scene.observations, 3)


def test_too_short_or_too_few(scene):
    rig, instants = scene.rig, scene.observations
    short = {
        name: CameraObservations(seen.boxes.take(seen.boxes.frame < seen.boxes.frame.min() + 20))
        for name, seen in instants.cameras.items()
    }
    assert hold_out(rig, replace(instants, cameras=short), HEIGHT_M, 0) is None
    assert hold_out(Rig(tuple(replace(camera, pose=None) for camera in rig)), instants, HEIGHT_M, 0) is None
    nobody = {name: CameraObservations() for name in rig.names}
    assert hold_out(rig, replace(instants, cameras=nobody), HEIGHT_M, 0) is None


def test_one_camera_against_the_others_by_hand(scene):
    rig, instants = scene.rig, scene.observations
    before = disagreements(rig, instants, HEIGHT_M)
    turn = np.radians(1.0)
    camera = rig["C3"]
    about_up = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    turned = replace(camera, pose=type(camera.pose).from_centre(about_up @ camera.pose.R_cw, camera.pose.centre))
    after = disagreements(Rig(tuple(turned if one.name == "C3" else one for one in rig)), instants, HEIGHT_M)
    degree_px = turn * camera.lens.matrix[0, 0]
    assert np.median(before["C3"].pixels) < 0.3 * degree_px
    assert np.median(after["C3"].pixels) == pytest.approx(degree_px, rel=0.3)
    assert max(np.median(one.pixels) for one in after.values()) == np.median(after["C3"].pixels)
    assert len(after["C3"]) == len(before["C3"])
