"""Bodies and joints at a sample of instants, against simulated truth; and residual maps, in which a wrong lens shows."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from passerby.core.cameras import Rig
from passerby.core.figures import AdjustedFigures, NoiseFigures, PeopleFigures, SolvedCamera
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.interchange.storage.text_formats import plain
from passerby.people.upright_bodies import UprightBodies, predict_boxes
from passerby.report.fitted import body_model, fit_people
from passerby.report.residuals import Residuals, residual_cells, residual_map, residuals_of
from passerby.report.sampling import sample_observations
from support.report.drawings import contents, longer, only_boxes, only_joints, simulated, with_lens
from support.report.svg import layer, of_class, parsed, scripts

ENOUGH = 4
"""Residuals of a cell, for an arrow."""


def exact(made, slack=0.0, foot_shift=0.1):
    """Contents whose boxes are the model's own: upright people at the true places, seen by the true cameras."""
    heights = {str(one): height / 0.99 for one, height in made.heights.items()}
    figures = AdjustedFigures(
        foot_shift=foot_shift, people=PeopleFigures(identities=len(heights), heights_m=heights),
        cameras=(SolvedCamera(name=made.rig.names[1], slack=slack),),
    )  # fmt: skip
    told, model = {"figures": plain(figures)}, body_model(figures, None)
    t, p = np.nonzero(np.isfinite(made.ground_positions[:, :, 0]))
    heights = np.array([made.heights[int(one)] for one in made.identities])
    nothing = np.zeros(len(t))
    bodies = UprightBodies(
        made.identities[p], made.frames[t], made.ground_positions[t, p], heights[p], nothing, nothing.astype(int)
    )
    seen = {}
    for place, camera in enumerate(made.rig):
        every = np.arange(len(t))
        ltwh, _, _ = predict_boxes(made.rig, np.full(len(t), place), bodies, every, np.full(len(t), 30.0), model)
        size = np.array(camera.lens.size)
        with np.errstate(invalid="ignore"):
            inside = ((ltwh[:, :2] > 5) & (ltwh[:, :2] + ltwh[:, 2:] < size - 5) & (ltwh[:, 2:] > 10)).all(axis=1)
        rows = np.flatnonzero(inside)
        boxes = Boxes(bodies.frame[rows], bodies.identity[rows], ltwh[rows], np.ones(len(rows)))
        seen[camera.name] = CameraObservations(boxes)
    return contents(made, seen=Observations(seen), told=told), bodies


@pytest.mark.parametrize("slack", [0.0, 0.12])
def test_boxes_of_the_model_are_fitted_without_a_rest(slack):
    made = simulated()
    told, bodies = exact(made, slack)
    fit = fit_people(told)
    s = fit.sightings
    assert len(s) > 1500
    assert s.agrees.all()
    several = fit.bodies.cameras[s.body] > 1
    for off in (*s.centre_px[several].T, s.top_px[several], s.bottom_px[several]):
        # The fit averages directions, a box pixels: 0.2 % of the height of somebody near the border of a wide lens.
        assert np.abs(off / s.seen[several, 3]).max() < 0.003
        assert np.quantile(np.abs(off), 0.99) < 0.25
    true = {(who, when): xy for who, when, xy in zip(bodies.identity, bodies.frame, bodies.xy, strict=True)}
    sure = fit.bodies.cameras > 1
    place = np.array([true[key] for key in zip(fit.bodies.identity[sure], fit.bodies.frame[sure], strict=True)])
    assert np.abs(fit.bodies.xy[sure] - place).max() < 0.005


@pytest.mark.parametrize(("preset", "px"), [("terrace", 1.4), ("basketball", 0.7), ("construction", 0.7)])
def test_simulated_bodies_are_met_to_a_pixel(preset, px):
    # The floor: bodies that walk are no upright sticks. Their boxes' middles are 0.7 to 0.9 % of their height off the model's
    # in the median, which is 1.2, 0.5 and 0.6 pixels here.
    made = simulated(preset, seconds=5.0)
    fit = fit_people(contents(made, seen=only_boxes(made)))
    s = fit.sightings
    assert s.agrees.mean() > 0.9
    assert np.median(np.linalg.norm(s.centre_px[s.agrees], axis=1)) < px
    assert np.abs(np.median(s.centre_px[s.agrees], axis=0)).max() < 0.2
    row = {int(who): k for k, who in enumerate(made.identities)}
    at = np.array([
        made.ground_positions[np.searchsorted(made.frames, when), row[int(who)]]
        for who, when in zip(fit.bodies.identity, fit.bodies.frame, strict=True)
    ])  # fmt: skip
    assert np.median(np.linalg.norm(fit.bodies.xy - at, axis=1)) < 0.12


def test_a_box_of_somebody_else_is_found_out():
    made = simulated()
    told, _ = exact(made)
    name = made.rig.names[0]
    boxes = told.observations[name].boxes
    rows = np.flatnonzero(boxes.frame == boxes.frame[0])[:2]
    swapped = np.array(boxes.identity)
    swapped[rows] = swapped[rows[::-1]]
    wrong = {**told.observations.cameras, name: CameraObservations(replace(boxes, identity=swapped))}
    fit = fit_people(replace(told, observations=Observations(wrong)))
    s = fit.sightings
    bad = (s.camera == 0) & (s.frame == boxes.frame[0]) & np.isin(s.identity, swapped[rows])
    assert not s.agrees[bad].any()
    assert s.agrees[~bad].all()
    assert np.linalg.norm(s.centre_px[bad], axis=1).min() > 10
    assert np.linalg.norm(s.centre_px[~bad & (fit.bodies.cameras[s.body] > 1)], axis=1).max() < 1.0


def test_joints_are_met_where_there_are_no_boxes():
    made = simulated(seconds=6.0)
    fit = fit_people(contents(made, seen=only_joints(made)))
    assert len(fit.sightings) == 0
    j = fit.joints
    assert j.agrees.mean() > 0.99
    assert np.abs(j.seen - j.model)[j.agrees].max() < 0.01
    assert len(fit.ways) > 100
    row = {int(who): k for k, who in enumerate(made.identities)}
    seconds = np.rint(fit.ways.seconds).astype(int)  # a frame stands for a second where no rate is known
    at = np.array(
        [made.joints3d[t, row[int(who)], :, :2].mean(axis=0) for t, who in zip(seconds, fit.ways.identity, strict=True)]
    )
    assert np.median(np.linalg.norm(fit.ways.xy - at, axis=1)) < 0.25


def test_nothing_is_found_and_nothing_fails_without_poses_or_without_people():
    made = simulated()
    for posed in (0, 1):
        cameras = [one if k < posed else replace(one, pose=None, sigma=None) for k, one in enumerate(made.rig)]
        fit = fit_people(contents(made, rig=Rig(tuple(cameras))))
        assert (len(fit.rig), fit.place(made.rig.names[-1])) == (posed, None)
        assert (fit.bodies.cameras <= 1).all()
        if not posed:
            assert fit.sample is None
            assert len(fit.ways) == len(fit.joints) == len(fit.bodies) == 0
    nobody = dict.fromkeys(made.rig.names, CameraObservations())
    unknown = {name: CameraObservations(replace(seen.boxes, identity=np.full(len(seen.boxes), -1)))
               for name, seen in made.observations.cameras.items()}  # fmt: skip
    for seen in (nobody, unknown):
        assert fit_people(contents(made, seen=Observations(seen))).sample is None


def test_the_sample_of_a_long_recording_is_bounded_and_evenly_spread():
    made, times, seen = simulated(), 100, {}
    for name, one in made.observations.cameras.items():
        boxes = one.boxes
        frame = np.concatenate([boxes.frame + int(made.frames[-1]) * k for k in range(times)])
        columns = np.tile(boxes.identity, times), np.tile(boxes.ltwh, (times, 1)), np.tile(boxes.score, times)
        seen[name] = CameraObservations(Boxes(frame, *columns))
    told = contents(made, seen=Observations(seen, 5.0))
    sample, again = sample_observations(told, 3000), sample_observations(told, 3000)
    frames = np.concatenate([sample.seen[name].boxes.frame for name in made.rig.names])
    assert 2000 < len(frames) <= 3300
    assert sample.step_s == pytest.approx(0.5, abs=0.15)
    share = np.unique(frames) / frames.max()
    assert all(np.any((share >= k / 8) & (share < (k + 1) / 8)) for k in range(8))
    assert all(np.array_equal(sample.seen[name].boxes.ltwh, again.seen[name].boxes.ltwh) for name in made.rig.names)


@pytest.mark.parametrize("unregistered", [False, True])
def test_clocks_that_differ_are_brought_together(unregistered):
    made = simulated()
    told, _ = exact(made)
    clocks = {name: Clock(5.0, 0.4 * place) for place, name in enumerate(made.rig.names)}
    if unregistered:  # then it may have no clock either
        del clocks[made.rig.names[-1]]
        told = replace(told, rig=Rig((*made.rig.cameras[:-1], replace(made.rig.cameras[-1], pose=None))))
    # Camera k counts its frames so that the same instants have other numbers.
    boxes = {name: told.observations[name].boxes for name in made.rig.names}
    seen = {
        name: CameraObservations(replace(one, frame=one.frame - 2 * place)) for place, (name, one) in enumerate(boxes.items())
    }
    fit = fit_people(replace(told, observations=Observations(seen, 5.0, clocks), clocks=clocks))
    several = fit.bodies.cameras[fit.sightings.body] > 1
    assert several.mean() > 0.9
    assert np.quantile(np.abs(fit.sightings.centre_px[several]), 0.99) < 0.25


def test_figures_that_make_no_sense_are_not_believed():
    noise = NoiseFigures(floor_px=-1.0, box_px=1e9, centre=-1.0, height=float("nan"), joint=0.0, broken_edges=9.0)
    strange = AdjustedFigures(
        foot_shift=7.0, noise=noise, people=PeopleFigures(identities=3, heights_m={"1": 900.0, "x": 1.7, "2": 1.8}),
        cameras=(SolvedCamera(name="A", slack=50.0),),
    )  # fmt: skip
    model, usual = body_model(strange, None), body_model(AdjustedFigures(), None)
    assert asdict(model.noise) == asdict(usual.noise)
    assert model.foot_shift == usual.foot_shift
    assert model.heights == {2: 1.8}
    assert model.slack == {"A": 0.0}


def cells_of(made, change, name, seen):
    """Cells of a camera whose lens is changed, and of each cell its mean residual outwards and across, pixels, and how far
    it is from the principal point.
    """
    rig = with_lens(made.rig, name, change)
    told = contents(made, rig=rig, seen=seen)
    cells = residual_cells(residuals_of(fit_people(told), name), rig[name].lens.size)
    row, column = np.nonzero(cells.count >= ENOUGH)
    place = np.column_stack([column + 0.5, row + 0.5]) * cells.size - made.rig[name].lens.matrix[:2, 2]
    far = np.linalg.norm(place, axis=1)
    unit = place / far[:, None]
    mean = cells.mean[row, column]
    across = mean[:, 0] * unit[:, 1] - mean[:, 1] * unit[:, 0]
    return cells, (mean * unit).sum(axis=1), across, far


@pytest.mark.parametrize("preset", ["terrace", "basketball"])
@pytest.mark.parametrize(("factor", "sign"), [(0.95, 1), (1.05, -1)])
def test_a_wrong_focal_length_points_outwards_or_inwards_everywhere_and_the_true_one_does_not(preset, factor, sign):
    made = simulated(preset)
    cells, outwards, across, far = cells_of(made, longer(factor), made.rig.names[1], only_boxes(made))
    assert len(outwards) >= 10
    beyond = far > 40
    assert (np.sign(outwards[beyond]) == sign).mean() > 0.95
    assert np.abs(outwards).mean() > 3 * np.abs(across).mean()
    # The farther from the middle, the more.
    assert sign * np.corrcoef(far, outwards)[0, 1] > 0.5
    assert cells.sure.sum() >= 0.8 * len(outwards)
    true = cells_of(made, longer(1.0), made.rig.names[1], only_boxes(made))[1]
    assert preset == "basketball" or abs(true.mean()) < 0.1 * abs(outwards.mean())


def test_a_wrong_distortion_grows_towards_the_border():
    made = simulated("basketball")

    def bent(lens):
        distortions = np.array(lens.distortions)
        distortions[0] += 0.08
        return replace(lens, distortions=distortions)

    name = made.rig.names[1]
    _, outwards, _, far = cells_of(made, bent, name, only_joints(made))
    outer, inner = far > np.quantile(far, 0.7), far < np.quantile(far, 0.4)
    assert np.abs(outwards[outer].mean()) > 3 * np.abs(outwards[inner].mean())


def test_cells_hold_means_and_scatter():
    rng = np.random.default_rng(0)
    at = rng.uniform(0, (600, 400), (5000, 2))
    miss = rng.normal((2.0, -1.0), 3.0, (5000, 2))
    cells = residual_cells(Residuals(at, miss, "joints"), (600, 400))
    assert cells.count.shape == (8, 12)
    assert cells.count.sum() == 5000
    assert cells.mean.reshape(-1, 2).mean(axis=0) == pytest.approx((2.0, -1.0), abs=0.2)
    assert np.sqrt((cells.rms**2).mean()) == pytest.approx(np.sqrt(2 * 9 + 5), rel=0.03)
    assert cells.sure.mean() > 0.9
    chance = residual_cells(Residuals(at, miss - (2.0, -1.0), "joints"), (600, 400))
    assert chance.sure.mean() < 0.25
    corners = np.array([[0.0, 0.0], [599.0, 399.0]])
    one = residual_cells(Residuals(corners, np.array([[1.0, 0.0], [0.0, 2.0]]), "joints"), (600, 400))
    assert one.count[0, 0] == one.count[-1, -1] == 1
    assert one.rms[-1, -1] == pytest.approx(2.0)


def test_the_map_draws_each_cell_and_its_arrow_to_scale_and_is_there_where_there_is_nothing_to_map():
    made = simulated()
    name = made.rig.names[1]
    rig = with_lens(made.rig, name, longer(1.05))
    told = contents(made, rig=rig, seen=only_boxes(made))
    fit = fit_people(told)
    svg = residual_map(told, fit, name)
    root = parsed(svg)
    cells = residual_cells(residuals_of(fit, name), rig[name].lens.size)
    assert len(list(layer(root, "cells"))) == np.count_nonzero(cells.count)
    factor = int(root.get("data-magnification"))
    arrows = {tuple(map(int, g.get("data-cell").split())): of_class(g, "arrow")[0] for g in layer(root, "arrows")}
    assert {(int(row), int(column)) for row, column in np.argwhere(cells.sure)} <= set(arrows)
    for (row, column), path in arrows.items():
        begin, end = (np.array(part.split(), float) for part in path.get("d").split("M")[1].split("L"))
        assert cells.count[row, column] >= ENOUGH
        assert np.abs(end - begin - factor * cells.mean[row, column]).max() < 0.11
        assert np.linalg.norm(end - begin) < 3.1 * min(cells.size)
        assert ("faint" in path.get("class")) != cells.sure[row, column]
    assert f"{factor} times" in svg
    assert svg == residual_map(told, fit_people(told), name)
    assert not scripts(svg)
    assert len(svg) < 60_000

    rig = replace(made.rig, cameras=tuple(replace(one, pose=None) for one in made.rig))
    told = contents(made, rig=rig)
    root = parsed(residual_map(told, fit_people(told), name))
    assert not list(layer(root, "cells"))
    assert any("no residuals" in (one.text or "") for one in root.iter())
