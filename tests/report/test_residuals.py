"""Residual maps: what is wrong with a lens shows in them."""

from dataclasses import replace

import numpy as np
import pytest

from passerby.report.fitted import fit_people
from passerby.report.residuals import FEWEST, Residuals, residual_cells, residual_map, residuals_of
from support.report.drawings import (
    contents,
    layer,
    longer,
    of_class,
    only_boxes,
    only_joints,
    parsed,
    scripts,
    simulated,
    with_lens,
)


def cells_of(made, change, name, seen):
    """Cells of a camera whose lens is changed, and of each cell its mean residual outwards and across, pixels, and how far
    it is from the principal point.
    """
    rig = with_lens(made.rig, name, change)
    told = contents(made, rig=rig, seen=seen)
    cells = residual_cells(residuals_of(fit_people(told), name), rig[name].lens.size)
    row, column = np.nonzero(cells.count >= FEWEST)
    place = np.column_stack([column + 0.5, row + 0.5]) * cells.size - made.rig[name].lens.matrix[:2, 2]
    far = np.linalg.norm(place, axis=1)
    unit = place / far[:, None]
    mean = cells.mean[row, column]
    across = mean[:, 0] * unit[:, 1] - mean[:, 1] * unit[:, 0]
    return cells, (mean * unit).sum(axis=1), across, far


@pytest.mark.parametrize("preset", ["terrace", "basketball"])
@pytest.mark.parametrize(("factor", "sign"), [(0.95, 1), (1.05, -1)])
def test_a_wrong_focal_length_points_outwards_or_inwards_everywhere(preset, factor, sign):
    made = simulated(preset)
    cells, outwards, across, far = cells_of(made, longer(factor), made.rig.names[1], only_boxes(made))
    assert len(outwards) >= 10
    beyond = far > 40
    assert (np.sign(outwards[beyond]) == sign).mean() > 0.95
    assert np.abs(outwards).mean() > 3 * np.abs(across).mean()
    # The farther from the middle, the more.
    assert sign * np.corrcoef(far, outwards)[0, 1] > 0.5
    assert cells.sure.sum() >= 0.8 * len(outwards)


def test_the_true_lens_shows_no_such_pattern():
    made = simulated()
    outwards, wrong = (cells_of(made, longer(factor), made.rig.names[1], only_boxes(made))[1] for factor in (1.0, 1.05))
    assert abs(outwards.mean()) < 0.1 * abs(wrong.mean())


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


def test_the_map_draws_each_cell_and_its_arrow_to_scale():
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
        assert cells.count[row, column] >= FEWEST
        assert np.abs(end - begin - factor * cells.mean[row, column]).max() < 0.11
        assert np.linalg.norm(end - begin) < 3.1 * min(cells.size)
        assert ("faint" in path.get("class")) != cells.sure[row, column]
    assert f"{factor} times" in svg
    assert svg == residual_map(told, fit_people(told), name)
    assert not scripts(svg)
    assert len(svg) < 60_000


def test_there_is_a_map_where_there_is_nothing_to_map():
    made = simulated()
    name = made.rig.names[0]
    rig = replace(made.rig, cameras=tuple(replace(one, pose=None) for one in made.rig))
    told = contents(made, rig=rig)
    root = parsed(residual_map(told, fit_people(told), name))
    assert not list(layer(root, "cells"))
    assert any("no residuals" in (one.text or "") for one in root.iter())
