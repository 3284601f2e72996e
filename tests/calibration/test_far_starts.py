"""A calibration of recordings that begin minutes apart."""

import numpy as np
import pytest

from passerby.calibration.in_memory import calibrate_observations
from passerby.evaluation.metrics import compare
from passerby.simulation.passing_crowd import CrowdOptions, simulate_crowd

STARTS_S = (0.0, 300.0, 150.0)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["combined", "given"])
def test_recordings_minutes_apart_are_calibrated(mode: str) -> None:
    options = CrowdOptions(1, starts_s=STARTS_S, seconds=600.0, identities_known=mode == "given")
    crowd = simulate_crowd(options)
    boxes = {name: seen.boxes for name, seen in crowd.observations.cameras.items()}
    association = {"mode": mode, "max_offset_s": 900.0}
    found = calibrate_observations(crowd.rig, fps=options.fps, association=association, boxes=boxes)
    assert found.verdict == "accepted"
    assert found.association is not None
    offsets = [found.association.clocks[name].offset_s for name in crowd.rig.names]
    np.testing.assert_allclose(offsets, STARTS_S, atol=0.05)
    assert [one.code for one in found.notices].count("starts_apart") == 1
    starts = found.association.figures.starts
    assert starts is not None
    assert {one.found_by for one in starts} == {"activity"}
    assert compare(found.rig.posed(), crowd.rig).similarity.mean_position_mm < 150.0


@pytest.mark.slow
def test_cameras_that_share_nobody_are_refused_with_the_reason() -> None:
    options = CrowdOptions(1, starts_s=STARTS_S[:2], seconds=600.0, strangers=(1,))
    crowd = simulate_crowd(options)
    boxes = {name: seen.boxes for name, seen in crowd.observations.cameras.items()}
    found = calibrate_observations(crowd.rig, fps=options.fps, association={"max_offset_s": 900.0}, boxes=boxes)
    assert (found.verdict, found.exit_status) == ("refused", 3)
    assert "start_unknown" in {one.code for one in found.diagnostics}
