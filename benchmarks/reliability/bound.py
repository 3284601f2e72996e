"""How near to the Cramer-Rao bound are the errors? Of simulated scenes, of upright bodies in their place, and without noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pages.records import Found
from pages.tables import Table, number, table
from paper.goals import BOX_NOISE
from passerby.calibration.in_memory import calibrate_observations
from passerby.common.arrays import Floats
from passerby.core.cameras import Pose, Rig
from passerby.core.observations import Boxes
from passerby.evaluation.metrics import compare, place
from passerby.simulation import PRESETS, SimulatedScene, SimulationOptions, simulate
from passerby.simulation.scene import film
from passerby.simulation.write import MEAN_SD
from reliability.cramer_rao import UprightScene, cramer_rao, model_edges
from reliability.page import Line, part_found
from reliability.runs import Wanted, kept, seeds

SEEDS = seeds(108_000, 12)
QUICK_SEEDS = 1
PEOPLE = (2, 4, 8, 16)
SECONDS = 40.0
ACCEPTABLE, AIM = 1.5, 1.2
"""Errors as multiples of the bound."""
WIDTH = 0.35
"""Of the model's boxes, as a share of their height: typical of people, and without influence on what the boxes tell."""
KINDS = ("position", "orientation")
"""Of errors, millimetres and degrees."""
SIMULATED, UPRIGHT, NOISELESS = "simulated", "upright", "noiseless"
"""The simulated scene; the model's own bodies at the same places, with the same noise; the simulated scene without noise."""
VARIANTS = (SIMULATED, UPRIGHT, NOISELESS)
PAIRS = (("C1", "C3"), ("C2", "C4"))
"""Cameras at opposite corners."""
Case = tuple[str, int, int]
"""Preset, number of people, seed."""
Results = Sequence[Mapping[str, Any]]


def work(case: Case) -> dict[str, Any]:
    """Errors of one scene in all variants, and the bounds."""
    preset, people, seed = case
    options = SimulationOptions(preset=preset, people=people, seed=seed, seconds=SECONDS, box_noise=BOX_NOISE)
    filmed = film(options)
    scene = simulate(options, filmed)
    clean = simulate(replace(options, box_noise=0.0), filmed)
    upright = upright_boxes(scene, np.random.default_rng([108, seed]))
    simulated = {name: camera.boxes for name, camera in scene.observations.cameras.items()}
    noiseless = {name: camera.boxes for name, camera in clean.observations.cameras.items()}
    bounds = {SIMULATED: least_errors(scene, simulated), UPRIGHT: least_errors(scene, upright)}
    variants = {SIMULATED: simulated, UPRIGHT: upright, NOISELESS: noiseless}
    found = {name: errors(scene, boxes) for name, boxes in variants.items()}
    return {"preset": preset, "people": people, "seed": seed, "bounds": bounds, "errors": found}


def upright_boxes(scene: SimulatedScene, rng: np.random.Generator) -> dict[str, Boxes]:
    """Camera -> boxes of the model's people at the true places, with the scene's noise, where the scene has whole boxes."""
    out = {}
    heights = _heights(scene)
    for camera in scene.rig:
        boxes = scene.truth[camera.name]
        whole = boxes.take(boxes.inside(camera.lens.size))
        places = scene.ground_positions[whole.frame - 1, whole.identity - 1]
        middle, top, bottom = model_edges(camera, places, heights[whole.identity - 1]).T
        half = 0.5 * WIDTH * (bottom - top)
        edges = np.column_stack([middle - half, top, middle + half, bottom])
        edges += scene.options.box_noise * (bottom - top)[:, None] * rng.standard_normal(edges.shape)
        ltwh = np.column_stack([edges[:, :2], edges[:, 2:] - edges[:, :2]])
        out[camera.name] = Boxes(whole.frame, whole.identity, ltwh, np.ones(len(whole)))
    return out


def upright_scene(scene: SimulatedScene, boxes: Mapping[str, Boxes]) -> UprightScene:
    """The truth behind the whole boxes of a scene whose identities are right."""
    camera, frame, identity = [], [], []
    for index, one in enumerate(scene.rig):
        whole = boxes[one.name].take(boxes[one.name].inside(one.lens.size))
        camera.append(np.full(len(whole), index))
        frame.append(whole.frame)
        identity.append(whole.identity)
    keys = np.column_stack([np.concatenate(frame), np.concatenate(identity)])
    key, instant = np.unique(keys, axis=0, return_inverse=True)
    places = scene.ground_positions[key[:, 0] - 1, key[:, 1] - 1]
    return UprightScene(scene.rig, _heights(scene), places, key[:, 1] - 1, np.concatenate(camera), instant.ravel())


def _heights(scene: SimulatedScene) -> Floats:
    """(P,) heights in the order of the identities, metres."""
    return np.array([scene.heights[int(identity)] for identity in scene.identities])


def least_errors(scene: SimulatedScene, boxes: Mapping[str, Boxes]) -> dict[str, Any] | None:
    """The bound by kind, (C,) each, and the share of it that is `opposite`; None where the boxes leave a pose undetermined."""
    bound = cramer_rao(upright_scene(scene, boxes), scene.options.box_noise, scene.options.person_height_sd_m)
    if bound is None:
        return None
    rows = np.arange(len(bound.covariance)).reshape(-1, 6)[:, :3].ravel()
    of_centres, along = bound.covariance[np.ix_(rows, rows)], opposite(scene.rig).ravel()
    share = float(along @ of_centres @ along / np.trace(of_centres))
    return {"position": bound.position_mm.tolist(), "orientation": bound.orientation_deg.tolist(), "share": share}


def errors(scene: SimulatedScene, boxes: Mapping[str, Boxes]) -> dict[str, Any]:
    """Verdict; errors by kind and camera after similarity alignment, and the motion that is `opposite`, millimetres.

    Without the errors where a camera has no pose.
    """
    options = scene.options
    scale = {
        "person_height_m": options.person_height_mean_m, "person_height_sd_m": options.person_height_sd_m,
        "person_height_mean_sd_m": MEAN_SD * options.person_height_mean_m,
    }  # fmt: skip
    found = calibrate_observations(scene.rig, boxes, fps=options.fps, association={"mode": "given"}, scale=scale)
    if len(found.rig.posed()) < len(scene.rig):
        return {"verdict": found.verdict}
    comparison = compare(found.rig, scene.rig).similarity
    placed = place(_poses(found.rig), _poses(scene.rig))
    assert placed is not None
    off = placed.apply(_centres(found.rig)) - _centres(scene.rig)
    return {
        "verdict": found.verdict,
        "position": [*comparison.position_mm.values()],
        "orientation": [*comparison.orientation_deg.values()],
        "opposite": float(1000 * (off * opposite(scene.rig)).sum()),
    }


def opposite(rig: Rig) -> Floats:
    """(4, 3) the unit motion of the centres over the ground by which the first pair of `PAIRS` moves to the middle of the area,
    and the second pair away from it. All four cannot move in together: that is a scale.
    """
    inwards = -_centres(rig) * np.array([1.0, 1.0, 0.0])
    inwards /= np.linalg.norm(inwards, axis=1, keepdims=True)
    sign = np.array([1.0 if name in PAIRS[0] else -1.0 for name in rig.names])
    return np.asarray(inwards * sign[:, None] / np.sqrt(len(rig)))


def _poses(rig: Rig) -> list[Pose]:
    return [camera.pose for camera in rig if camera.pose is not None]


def _centres(rig: Rig) -> Floats:
    return np.array([camera.centre for camera in rig])


def run(wanted: Wanted) -> Found:
    """All presets, numbers of people and seeds."""
    some = SEEDS[:QUICK_SEEDS] if wanted.quick else SEEDS
    cases = {f"{preset} {people} {seed}": (preset, people, seed) for preset in PRESETS for people in PEOPLE for seed in some}
    found = [*kept(wanted, "bound", cases, work).values()]
    return part_found(_lines(found), *tabulate(found))


def complete(results: Results) -> list[Mapping[str, Any]]:
    """Scenes with a bound, all of whose cameras have a pose in all variants."""
    return [
        one for one in results
        if None not in one["bounds"].values() and all(found.get("position") for found in one["errors"].values())
    ]  # fmt: skip


def root_mean_square(results: Results, where: str, variant: str, kind: str) -> float:
    """Over all cameras of the scenes, of the `errors` or the `bounds`; NaN of none."""
    squares = [value**2 for one in results for value in one[where][variant][kind]]
    return float(np.sqrt(np.mean(squares))) if squares else float("nan")


def ratio(results: Results, variant: str, kind: str) -> float:
    """Errors of a variant over its bound, root mean squares over all cameras of the scenes."""
    bound = root_mean_square(results, "bounds", variant, kind)
    return root_mean_square(results, "errors", variant, kind) / bound


def _groups(results: Results, presets: Sequence[str] = tuple(PRESETS)) -> dict[tuple[str, int], list[Mapping[str, Any]]]:
    """The complete scenes by preset and number of people, where there are any."""
    groups = {
        (preset, people): [one for one in complete(results) if (one["preset"], one["people"]) == (preset, people)]
        for preset in presets
        for people in PEOPLE
    }
    return {key: group for key, group in groups.items() if group}


def _lines(results: Results) -> list[Line]:
    """What goes into the table over all parts: by preset the range over the numbers of people."""
    lines = []
    goal = f"{ACCEPTABLE:g}; {AIM:g} is aimed at"
    for preset in PRESETS:
        groups = _groups(results, [preset])
        for kind in KINDS if groups else ():
            ratios = [ratio(group, SIMULATED, kind) for group in groups.values()]
            seen = f"{min(ratios):.1f} to {max(ratios):.1f}"
            lines.append(Line(f"errors over the Cramer-Rao bound: {preset}, {kind}", seen, goal, max(ratios) <= ACCEPTABLE))
    return lines


def tabulate(results: Results) -> tuple[dict[str, Table], list[str]]:
    """The table by preset and people, that of opposite cameras, and what they say."""
    groups = _groups(results)
    rows = [_row(preset, people, group) for (preset, people), group in groups.items()]
    head = ("preset", "people", "scenes", "bound", UPRIGHT, NOISELESS, SIMULATED, "upright / bound", "simulated / bound")
    pair_rows = [_pair_row(preset, one) for preset in PRESETS if (one := _of_preset(results, preset))]
    tables = {"By number of people": table(head, rows), "Opposite cameras": table(("preset", "bound", *VARIANTS), pair_rows)}
    return tables, [_said(results, groups), _pairs_said(results)]


def _row(preset: str, people: int, group: Results) -> list[str]:
    """One line of the first table: absolute figures, then ratios of position and orientation."""
    figures = [_pair(group, "bounds", SIMULATED)] + [
        _pair(group, "errors", variant) for variant in (UPRIGHT, NOISELESS, SIMULATED)
    ]
    ratios = [", ".join(number(ratio(group, variant, kind), 2) for kind in KINDS) for variant in (UPRIGHT, SIMULATED)]
    return [preset, str(people), str(len(group)), *figures, *ratios]


def _pair(group: Results, where: str, variant: str) -> str:
    position, orientation = (root_mean_square(group, where, variant, kind) for kind in KINDS)
    return f"{number(position)}, {number(orientation, 3)}"


def _of_preset(results: Results, preset: str) -> list[Mapping[str, Any]]:
    return [one for one in complete(results) if one["preset"] == preset]


def _spread(values: Sequence[float], digits: int = 1) -> str:
    return f"{number(min(values), digits)} to {number(max(values), digits)}"


def _said(results: Results, groups: Mapping[tuple[str, int], Results]) -> str:
    """What the first table says, in sentences."""
    whole = complete(results)
    if not whole:
        return "No scene has a bound and all cameras."
    accepted = sum(one["errors"][SIMULATED]["verdict"] == "accepted" for one in whole)
    ratios = {
        (variant, kind): [ratio(group, variant, kind) for group in groups.values()]
        for variant in VARIANTS[:2]
        for kind in KINDS
    }
    met = sum(max(pair) <= ACCEPTABLE for pair in zip(*(ratios[SIMULATED, kind] for kind in KINDS), strict=True))
    aimed = sum(max(pair) <= AIM for pair in zip(*(ratios[SIMULATED, kind] for kind in KINDS), strict=True))
    beyond, bodies = [], []
    for group in groups.values():
        simulated, upright, noiseless = (root_mean_square(group, "errors", one, "position") for one in VARIANTS)
        beyond.append(1 - (upright / simulated) ** 2)
        bodies.append(noiseless / root_mean_square(group, "bounds", SIMULATED, "position"))
    percent = _spread([100 * one for one in beyond], 0)
    sentences = [
        f"The table has {len(whole)} of {len(results)} scenes, of which {accepted} are accepted; in the others a camera has no "
        "pose, or the boxes do not determine one.",
        f"For upright people the ratio is {_spread(ratios[UPRIGHT, 'position'], 2)} (position) and "
        f"{_spread(ratios[UPRIGHT, 'orientation'], 2)} (orientation).",
        f"For simulated people it is {_spread(ratios[SIMULATED, 'position'], 2)} and "
        f"{_spread(ratios[SIMULATED, 'orientation'], 2)}: {met} of {len(groups)} lines are at {ACCEPTABLE:g} or below in both, "
        f"{aimed} at {AIM:g} or below.",
        f"Without any noise of the boxes the positions of simulated people are still off by {_spread(bodies)} times the bound.",
        f"Of the squared position errors of simulated people, {percent} % are beyond those of upright people with the same "
        "noise: what bodies do and the model of the person leaves out.",
        *_falls(groups),
    ]
    return "\n".join(sentences)


def _falls(groups: Mapping[tuple[str, int], Results]) -> list[str]:
    """How bound and errors fall from the fewest people to the most: noise averages out, what people have in common does not."""
    few, many = min(PEOPLE), max(PEOPLE)
    presets = [preset for preset in PRESETS if (preset, few) in groups and (preset, many) in groups]
    if not presets:
        return []

    def factors(where: str, variant: str) -> str:
        rms = {key: root_mean_square(group, where, variant, "position") for key, group in groups.items()}
        return _spread([rms[preset, few] / rms[preset, many] for preset in presets])

    return [
        f"From {few} to {many} people the bound of the positions falls by a factor of {factors('bounds', SIMULATED)}, the "
        f"errors by {factors('errors', UPRIGHT)} (upright), {factors('errors', SIMULATED)} (simulated) and "
        f"{factors('errors', NOISELESS)} (noiseless)."
    ]


def opposite_share(results: Results, variant: str) -> float:
    """The share of the squared position errors that is the motion `opposite`."""
    moved = sum(one["errors"][variant]["opposite"] ** 2 for one in results)
    return float(moved / sum(value**2 for one in results for value in one["errors"][variant]["position"]))


def opposite_by_seed(results: Results, variant: str) -> Floats:
    """(S,) how far each camera of the first pair moves in, mean over the scenes of a seed, millimetres.

    The cameras of a preset and seed are the same for all numbers of people.
    """
    own = [[one["errors"][variant]["opposite"] for one in results if one["seed"] == seed] for seed in _seeds(results)]
    # Each of the four cameras moves by half of the length of the motion.
    return np.array([np.mean(values) / 2 for values in own])


def _seeds(results: Results) -> list[int]:
    return sorted({one["seed"] for one in results})


def _pair_row(preset: str, results: Results) -> list[str]:
    """One line of the second table."""
    cells = [f"{100 * np.mean([one['bounds'][SIMULATED]['share'] for one in results]):.0f} %"]
    for variant in VARIANTS:
        by = opposite_by_seed(results, variant)
        error = float(by.std(ddof=1) / np.sqrt(len(by))) if len(by) > 1 else float("nan")
        share = 100 * opposite_share(results, variant)
        cells.append(f"{share:.0f} % ({by.mean():+.1f} ± {number(error)} mm, {int((by > 0).sum())} of {len(by)})")
    return [preset, *cells]


def _pairs_said(results: Results) -> str:
    """What the second table says."""
    sentences = []
    for preset in PRESETS:
        own = _of_preset(results, preset)
        if not own:
            continue
        bound = float(np.mean([one["bounds"][SIMULATED]["share"] for one in own]))
        share = opposite_share(own, NOISELESS)
        alike = np.mean([one["errors"][NOISELESS]["opposite"] * one["errors"][SIMULATED]["opposite"] > 0 for one in own])
        more = "more" if share > bound else "no more"
        sentences.append(
            f"On {preset} bodies alone move opposite cameras by {100 * share:.0f} % of their squared errors, {more} than noise "
            f"would by the bound ({100 * bound:.0f} %); with the noise they move alike in {100 * alike:.0f} % of the scenes."
        )
    return "\n".join(sentences)
