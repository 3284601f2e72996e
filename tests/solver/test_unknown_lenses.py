"""Lenses that nobody knows: focal length, principal point and distortion come from identified people in several views."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.cameras import Camera, Lens, Rig
from passerby.core.figures import adjusted
from passerby.core.observations import CameraObservations, Observations
from passerby.core.scale_cues import ScaleCues
from passerby.simulation.options import SimulationOptions
from passerby.simulation.scene import simulate
from passerby.solver.evidence import gather_evidence
from passerby.solver.focal_search import search_focals
from passerby.solver.initialisation import PeopleOptions
from passerby.solver.lens_unknowns import LENS_PARTS, LensUnknowns
from passerby.solver.people import solve_people

UNKNOWN = LensUnknowns(LENS_PARTS)


def boxes_only(observations):
    cameras = {}
    for name, seen in observations.cameras.items():
        nobody = seen.keypoints.take(np.zeros(len(seen.keypoints), bool))
        cameras[name] = CameraObservations(seen.boxes, nobody)
    return Observations(cameras, observations.fps, observations.clocks)


@pytest.fixture(scope="module")
def simulated():
    return simulate(SimulationOptions(preset="terrace", seed=40, seconds=30.0, box_noise=0.02, missing=0.1))


def unknown(rig, *known):
    return Rig(tuple(Camera(c.name, c.lens if c.name in known else Lens.unknown(c.lens.size)) for c in rig))


def factors(found, true):
    return np.array([found[camera.name].lens.focal / camera.lens.focal for camera in true])


@pytest.mark.slow
def test_the_grounds_of_pairs_tell_first_focal_lengths(simulated):
    stated = unknown(simulated.rig)
    rng = np.random.default_rng(0)
    evidence = gather_evidence(stated, boxes_only(simulated.observations), rng, max_sightings=4000)
    found = search_focals(evidence, stated, UNKNOWN, 1.72, rng)
    wrong = np.abs(np.log(factors(stated, simulated.rig)))
    left = np.abs(np.log(factors(found, simulated.rig)))
    assert wrong.max() > 0.15, "the guess is far off"
    assert left.max() < 0.15
    assert all(camera.lens.uncalibrated for camera in found), "the search is not the last word"


@pytest.mark.slow
def test_known_lenses_stay_in_the_search(simulated):
    stated = unknown(simulated.rig, "C1", "C3")
    rng = np.random.default_rng(0)
    evidence = gather_evidence(stated, boxes_only(simulated.observations), rng, max_sightings=2000)
    found = search_focals(evidence, stated, UNKNOWN, 1.72, rng)
    assert found["C1"].lens is stated["C1"].lens
    assert found["C3"].lens is stated["C3"].lens
    assert np.abs(np.log(factors(found, simulated.rig))).max() < 0.15


@pytest.mark.slow
@pytest.mark.parametrize("known", [(), ("C2",)])
def test_lenses_and_rig_are_found_together(simulated, known):
    observations = boxes_only(simulated.observations)
    options = PeopleOptions(refine_lens=LENS_PARTS)
    solution = solve_people(unknown(simulated.rig, *known), observations, ScaleCues(), options, rng=np.random.default_rng(0))
    assert len(solution.rig.posed()) == 4
    off = np.abs(np.log(factors(solution.rig, simulated.rig)))
    assert off.max() < 0.06
    lenses = adjusted(solution.figures).lenses
    assert sorted(lenses) == [name for name in simulated.rig.names if name not in known], "known lenses are held"
    for name, parts in lenses.items():
        error = abs(np.log(parts.focal.refined_px / simulated.rig[name].lens.focal))
        assert error < 3 * parts.focal.sigma_px / parts.focal.refined_px
        assert not solution.rig[name].lens.uncalibrated
    for name in known:
        assert factors(solution.rig, simulated.rig)[simulated.rig.names.index(name)] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.slow
def test_keypoints_tell_lenses_better():
    made = simulate(
        SimulationOptions(preset="basketball", seed=41, seconds=30.0, box_noise=0.02, missing=0.1, joint_noise_px=2.0)
    )
    options = PeopleOptions(refine_lens=LENS_PARTS)
    solution = solve_people(unknown(made.rig), made.observations, ScaleCues(), options, rng=np.random.default_rng(0))
    assert np.abs(np.log(factors(solution.rig, made.rig))).max() < 0.02
    for camera in made.rig:
        assert solution.rig[camera.name].lens.distortions[0] == pytest.approx(camera.lens.distortions[0], abs=0.05)


@pytest.mark.slow
def test_a_search_that_went_wrong_does_not_hold_focal_lengths():
    """A search is a start. Joints determine focal lengths that it missed by a factor of two."""
    made = simulate(SimulationOptions(preset="terrace", seed=43, cameras=3, people=3, seconds=15.0, joint_noise_px=1.0))
    start = [
        replace(c, pose=None, lens=Lens.unknown(c.lens.size).started(0.5 * c.lens.focal / c.lens.size[0], 0.1))
        for c in made.rig
    ]
    options = PeopleOptions(refine_lens=LENS_PARTS)
    solution = solve_people(Rig(tuple(start)), made.observations, ScaleCues(), options, rng=np.random.default_rng(0))
    assert len(solution.rig.posed()) == 3
    assert np.abs(np.log(factors(solution.rig, made.rig))).max() < 0.02


def test_a_searched_focal_length_is_a_start_and_no_knowledge():
    lens = Lens.unknown((1000, 800))
    started = Rig((Camera("A", lens.started(2.0, 0.1)),))
    assert started["A"].lens.focal == pytest.approx(2 * lens.focal)
    assert UNKNOWN.core(started)[0, 0] == UNKNOWN.core(Rig((Camera("A", lens),)))[0, 0]
    assert UNKNOWN.core(started, near_start=True)[0, 0] == pytest.approx(0.1)


def test_only_free_parts_leave_what_is_stated():
    rig = Rig((Camera("A", Lens.unknown((1000, 800))), Camera("B", replace(Lens.unknown((1000, 800)), uncalibrated=False))))
    free, focal_only = UNKNOWN.core(rig), UNKNOWN.core(rig, free=("focal",))
    assert (free[0] > 1e-3).all()
    assert (focal_only[0, 1:] < 0.02).all()
    assert focal_only[0, 0] == free[0, 0]
    assert (free[1, 1:] < 0.02).all(), "a lens with intrinsics is held beside one without"


@pytest.mark.slow
def test_cameras_of_one_model_share_their_lens():
    """Four views of one lens say more of it than one view of each of four."""
    made = simulate(SimulationOptions(preset="terrace", seed=42, seconds=30.0, box_noise=0.02, missing=0.1, lenses="shared"))
    observations, options = boxes_only(made.observations), PeopleOptions(refine_lens=LENS_PARTS)
    sigma = {}
    for group in (None, "dome"):
        rig = Rig(tuple(Camera(c.name, Lens.unknown(c.lens.size, group=group)) for c in made.rig))
        solution = solve_people(rig, observations, ScaleCues(), options, rng=np.random.default_rng(0))
        focals = [parts.focal for parts in adjusted(solution.figures).lenses.values()]
        sigma[group] = np.median([focal.sigma_px / focal.refined_px for focal in focals])
    off = np.log(factors(solution.rig, made.rig))
    assert np.abs(off).max() < 0.02
    assert np.ptp(off) < 0.003, "but for what one unit differs from another"
    assert np.ptp([camera.lens.distortions[0] for camera in solution.rig]) < 0.01
    assert sigma["dome"] < 0.5 * sigma[None]


@pytest.mark.slow
def test_fisheye_lenses_are_found(monkeypatch):
    def fisheye(picture, rng):
        focal = picture[0] * rng.uniform(0.35, 0.6)
        matrix = np.array([[focal, 0, picture[0] / 2], [0, focal, picture[1] / 2], [0, 0, 1.0]])
        return Lens(picture, matrix, np.array([rng.uniform(-0.05, 0.05), 0, 0, 0]), fisheye=True)

    monkeypatch.setattr("passerby.simulation.lenses._make_typical_lens", fisheye)
    made = simulate(SimulationOptions(preset="terrace", seed=43, seconds=30.0, box_noise=0.02, missing=0.1))
    rig = Rig(tuple(Camera(c.name, Lens.unknown(c.lens.size, fisheye=True)) for c in made.rig))
    options = PeopleOptions(refine_lens=LENS_PARTS)
    solution = solve_people(rig, boxes_only(made.observations), ScaleCues(), options, rng=np.random.default_rng(0))
    assert len(solution.rig.posed()) == 4
    assert all(camera.lens.fisheye for camera in solution.rig)
    assert np.abs(np.log(factors(solution.rig, made.rig))).max() < 0.04
