"""Boxes on a grid: of blocks that are coarse beside people, and of whole pixels, which are not."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.core.figures import AdjustedFigures, CueFigures
from passerby.core.observations import Boxes
from passerby.findings.finding import notice
from passerby.scene.box_interpretations import FEWEST_FOR_GRID, adjust_for_coarse_boxes, notice_of_coarse_boxes

N = 300


@pytest.fixture
def boxes():
    rng = np.random.default_rng(0)
    height = rng.uniform(90, 200, N)
    ltwh = np.column_stack([rng.uniform(0, 1200, N), rng.uniform(0, 500, N), 0.4 * height, height])
    return Boxes(np.arange(N), np.ones(N, dtype=np.int64), ltwh, np.ones(N))


def rounded(boxes, step):
    near, far = boxes.ltwh[:, :2], boxes.ltwh[:, :2] + boxes.ltwh[:, 2:]
    near, far = step * np.floor(near / step), step * np.ceil(far / step)
    return replace(boxes, ltwh=np.concatenate([near, far - near], axis=1))


@pytest.mark.parametrize("step", [20, 64])
def test_blocks_are_told(boxes, step):
    found = notice_of_coarse_boxes("gate", rounded(boxes, step))
    assert (found.code, found.severity, found.cameras) == ("boxes_coarse", "notice", ("gate",))
    assert found.values["step_px"] == step


@pytest.mark.parametrize("step", [1, 8])
def test_fine_grids_are_none(boxes, step):
    assert notice_of_coarse_boxes("gate", rounded(boxes, step)) is None


def test_a_few_boxes_that_the_border_clips_do_not_hide_the_blocks(boxes):
    blocks = rounded(boxes, 32)
    ltwh = blocks.ltwh.copy()
    ltwh[:5, 3] = 719.0 - ltwh[:5, 1]
    assert notice_of_coarse_boxes("gate", replace(blocks, ltwh=ltwh)) is not None


def test_few_boxes_have_no_grid(boxes):
    assert notice_of_coarse_boxes("gate", rounded(boxes, 32).take(np.arange(FEWEST_FOR_GRID - 1))) is None


@pytest.mark.parametrize(("share", "sigma"), [(1.0, 0.25), (0.5, 0.18), (0.0, 0.15)])
def test_blocks_make_a_scale_uncertain_that_rests_on_how_tall_people_are(share, sigma):
    """Blocks of a fifth of a person: the scale by people is as uncertain; a measured length is not."""

    def cue(kind, share):
        return CueFigures(cue=kind, kind=kind, stated_m=1.7, measured_m=1.7, sd_m=0.05, residual_sigmas=0.0, share=share)

    cues = (cue("population", share), cue("length", 1 - share))
    figures = AdjustedFigures(scale=replace(AdjustedFigures().scale, relative_sigma=0.15, cues=cues))
    found = [notice("boxes_coarse", "gate", step_px=20, height_px=100.0)]
    assert adjust_for_coarse_boxes(figures, found).scale.relative_sigma == pytest.approx(sigma, abs=0.01)
    assert adjust_for_coarse_boxes(figures, []) == figures
