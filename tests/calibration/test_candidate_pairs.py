"""Which pairs of cameras a calibration compares: all in small scenes, candidates in large ones, or what the user says."""

from types import SimpleNamespace

import pytest

import passerby
from passerby.calibration.association_run import AssociationOptions
from passerby.calibration.association_start import _find_candidates
from passerby.common.progress import silent
from passerby.simulation import SimulationOptions, simulate


@pytest.mark.parametrize(
    ("count", "search_s", "options", "all_pairs"),
    [
        (12, 5.0, AssociationOptions(), True),
        (13, 5.0, AssociationOptions(), False),
        (13, 0.0, AssociationOptions(mode="trajectory"), False),
        (13, 5.0, AssociationOptions(mode="appearance"), True),
        (13, 600.0, AssociationOptions(), True),
        (3, 600.0, AssociationOptions(mode="appearance", groups=(("C1", "C3"),)), False),
    ],
)
def test_when_all_pairs_are_compared(count, search_s, options, all_pairs):
    cameras = [SimpleNamespace(name=f"C{number + 1}", tracks=None) for number in range(count)]
    found = _find_candidates(cameras, search_s, options, silent)
    assert (found is None) == all_pairs
    if options.groups:
        assert list(found.found_by) == [(0, 2)]


@pytest.mark.slow
def test_groups_of_the_scene_file_are_the_pairs_of_the_calibration():
    scene = simulate(SimulationOptions(seed=807, seconds=20.0, unrelated_ids=True, box_noise=0.01))
    boxes = {name: seen.boxes for name, seen in scene.observations.cameras.items()}
    groups = [["C1", "C2", "C3"], ["C3", "C4"]]
    tables = {"sites": {"groups": groups}, "association": {"max_offset_s": 0}}
    found = passerby.calibrate_observations(scene.rig, boxes, fps=5.0, **tables)
    assert found.association is not None
    figures = found.association.figures
    assert figures.pairs_tried.tried == figures.pairs_tried.stated == 4
    assert {frozenset(pair.cameras) for pair in figures.pairs} == {
        frozenset(pair) for pair in (("C1", "C2"), ("C1", "C3"), ("C2", "C3"), ("C3", "C4"))
    }
    assert len(found.rig.posed()) == 4
