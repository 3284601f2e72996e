"""Hostile people: who walks where the rig cannot be told, or looks like somebody else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from passerby.common.arrays import Floats
from passerby.core.cameras import Rig
from passerby.core.observations import Boxes
from passerby.simulation.motion import Motion
from reliability.staging import HandedIn, aimed, joined, raised, staged, still, walking

Build = Callable[[int], HandedIn]


def _on_line(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    """Everybody on one straight line across the area."""
    direction = np.array([np.cos(a := rng.uniform(0, np.pi)), np.sin(a)])
    along = motion.state.xy @ direction
    return walking(motion, along[..., None] * direction, heights)


def _on_spot(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    """Everybody stands near one spot."""
    return still(motion, rng.uniform(-0.15, 0.15, (len(heights), 2)))


def _standing(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
    """Everybody stands, each somewhere else."""
    return still(motion, motion.state.xy[0])


def _mirrored_teams(jitter_m: float) -> Callable[[Motion, Floats, np.random.Generator], Motion]:
    """The second half of the people walk point-symmetrically to the first half."""

    def move(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        half = len(heights) // 2
        first = motion.state.xy[:, :half]
        at = np.arange(len(first))[:, None, None] * 0.04
        sway = jitter_m * np.sin(2 * np.pi * at / rng.uniform(6, 12, (1, half, 2)) + rng.uniform(0, 6, (1, half, 2)))
        moved = walking(motion, np.concatenate([first, -first + sway], axis=1), heights)
        return replace(moved, present_from=np.full(len(heights), -np.inf))

    return move


def _symmetric(rig: Rig, rng: np.random.Generator) -> Rig:
    """Cameras that see the whole court."""
    for camera in rig:
        assert camera.pose is not None
        rig = aimed(rig, camera.name, camera.pose.centre * (1.3, 1.3, 2.0), np.array([0.0, 0.0, 0.8]))
    return rig


def symmetric_court(seed: int, *, jitter_m: float, given: bool = False, people: int = 8) -> HandedIn:
    """Two teams that move point-symmetrically."""
    return staged(seed, preset="basketball", given=given, people=people, people_move=_mirrored_teams(jitter_m), rig=_symmetric,
                  person_height_sd_m=0.05)  # fmt: skip


def teams_confused(seed: int, *, jitter_m: float) -> HandedIn:
    """The same with given identities, but one camera takes each player for the opponent."""
    scene = symmetric_court(seed, jitter_m=jitter_m, given=True)
    boxes = scene.boxes["C3"]
    known = boxes.identity > 0
    other = np.where(known, (boxes.identity - 1 + 4) % 8 + 1, boxes.identity)
    return scene.with_boxes("C3", replace(boxes, identity=other))


def _in_step(spacing_m: float, wander_m: float) -> Callable[[Motion, Floats, np.random.Generator], Motion]:
    """A grid of people who all walk one way together."""

    def move(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        n = len(heights)
        columns = int(np.ceil(np.sqrt(n)))
        grid = np.array([(k % columns, k // columns) for k in range(n)], float)
        grid = (grid - grid.mean(axis=0)) * spacing_m
        path = motion.state.xy[:, :1] * 0.5
        at = np.arange(len(path))[:, None, None] * 0.04
        own = wander_m * np.sin(2 * np.pi * at / rng.uniform(5, 9, (1, n, 2)) + rng.uniform(0, 6, (1, n, 2)))
        moved = walking(motion, path + grid + own, heights)
        return replace(moved, present_from=np.full(n, -np.inf))

    return move


def in_step(seed: int, *, wander_m: float, given: bool = False, shifted: bool = False) -> HandedIn:
    """A crowd in step; with `shifted` identities one camera takes each for the neighbour in the row."""
    scene = staged(seed, preset="construction", given=given, people=9, people_move=_in_step(2.5, wander_m),
                   person_height_sd_m=0.05)  # fmt: skip
    if shifted:
        boxes = scene.boxes["C2"]
        first = (boxes.identity - 1) % 3 == 0
        neighbour = np.where((boxes.identity > 0) & ~first, boxes.identity - 1, -1)
        scene = scene.with_boxes("C2", replace(boxes, identity=neighbour))
    return scene


def one_side(seed: int, *, given: bool) -> HandedIn:
    """All people keep to one end of the area."""

    def move(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        return walking(motion, motion.state.xy * (0.3, 0.15) + (1.5, 4.0), heights)

    return staged(seed, given=given, people_move=move)


def sloped(seed: int, *, grade: float, given: bool = True) -> HandedIn:
    """Ground that rises along x. A rig's ground is what people walk on: the truth is laid upon it."""
    scene = staged(
        seed, preset="construction", given=given, people_move=lambda m, h, r: raised(m, lambda xy: grade * xy[..., 0])
    )
    c, s = np.array([1.0, grade]) / np.hypot(1.0, grade)
    return replace(scene, truth=scene.truth.moved(np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), np.zeros(3)))


def stepped(seed: int, *, height_m: float, given: bool = True) -> HandedIn:
    """Two levels with stairs of a metre's length between them."""

    def move(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        return raised(motion, lambda xy: height_m * (np.clip(np.ceil(xy[..., 1] * 6) / 6, -0.5, 0.5)))

    return staged(seed, given=given, people_move=move)


def children(seed: int, *, given: bool) -> HandedIn:
    """Children of 1.1 m, and nobody said so."""
    return staged(seed, given=given, person_height_mean_m=1.1, person_height_sd_m=0.06, fps=10.0)


def looking_glass(seed: int, *, cameras: tuple[str, ...]) -> HandedIn:
    """A wall of mirrors: some cameras see everybody a second time, on the other side of it."""
    scene = staged(seed, given=False)

    def reflected(motion: Motion, heights: Floats, rng: np.random.Generator) -> Motion:
        xy = motion.state.xy * (-1.0, 1.0) + (7.6, 0.0)
        state = replace(motion.state, xy=xy, heading=np.pi - motion.state.heading)
        return replace(motion, state=state)

    behind = staged(seed, given=False, people_move=reflected, false_boxes=0.0)
    for name in cameras:
        first, second = scene.boxes[name], behind.boxes[name]
        second = replace(second, identity=second.identity + 1000)
        boxes, order = joined(first, second)
        who = np.concatenate([scene.who[name], np.full(len(second), -1)])[order]
        scene = scene.with_boxes(name, boxes, who)
    return scene


def big_screen(seed: int, *, given: bool) -> HandedIn:
    """A screen in the view of C1 shows what C3 films; with identities, those seen on it are known by their names."""
    scene = staged(seed, given=given)
    shown, own = scene.boxes["C3"], scene.boxes["C1"]
    size = np.array(scene.lenses["C1"].lens.size, float)
    corner, width = size * (0.05, 0.05), 0.35
    ltwh = np.concatenate([corner + width * shown.ltwh[:, :2], width * shown.ltwh[:, 2:]], axis=1)
    identity = shown.identity + (0 if given else 1000)
    identity = np.where(shown.identity < 0, -1, identity)
    screen = Boxes(shown.frame, identity, ltwh, shown.score)
    if given:
        there = set(zip(own.frame.tolist(), own.identity.tolist(), strict=True))
        new = [pair not in there for pair in zip(screen.frame.tolist(), screen.identity.tolist(), strict=True)]
        screen = screen.take(np.array(new))
    boxes, order = joined(own, screen)
    return scene.with_boxes("C1", boxes, np.concatenate([scene.who["C1"], np.full(len(screen), -1)])[order])


def posters(seed: int, *, given: bool, share: float = 0.5) -> HandedIn:
    """Three posters or statues in each view, at places that have nothing to do with each other, tracked as people.

    With identities given, re-identification calls them people 1 to 3 where these are not in the view.
    """
    scene = staged(seed, given=given)
    for index, name in enumerate(scene.lenses.names):
        rng = np.random.default_rng((seed, 5, index))
        own = scene.boxes[name]
        size = np.array(scene.lenses[name].lens.size, float)
        frames = np.unique(own.frame)
        parts = []
        for k in range(3):
            height = rng.uniform(0.15, 0.4) * size[1]
            left, top = rng.uniform(0.1, 0.9) * size[0], rng.uniform(0.2, 0.5) * size[1]
            ltwh = np.array([left, top, 0.4 * height, height]) + 0.01 * height * rng.standard_normal((len(frames), 4))
            seen = rng.uniform(size=len(frames)) < share
            identity = np.full(len(frames), (1 if given else 2000) + k)
            parts.append(Boxes(frames, identity, ltwh, np.ones(len(frames))).take(seen))
        for part in parts:
            there = set(zip(own.frame.tolist(), own.identity.tolist(), strict=True))
            new = [pair not in there for pair in zip(part.frame.tolist(), part.identity.tolist(), strict=True)]
            part = part.take(np.array(new, dtype=bool))
            who = np.concatenate([scene.who[name], np.full(len(part), -1)])
            own, order = joined(own, part)
            scene = scene.with_boxes(name, own, who[order])
    return scene


PEOPLE: Mapping[str, tuple[str, Build]] = MappingProxyType(
    {
        "line-given": ("all walk on one straight line", partial(staged, people_move=_on_line)),
        "line-found": ("the same, identities found", partial(staged, given=False, people_move=_on_line)),
        "spot-one": ("one person stands on the spot", partial(staged, people=1, people_move=_on_spot)),
        "spot-found": ("three on one spot, identities found", partial(staged, given=False, people=3, people_move=_on_spot)),
        "standing": ("all stand, each somewhere else", partial(staged, given=False, people_move=_standing)),
        "court-exact": ("teams move point-symmetrically, identities found", partial(symmetric_court, jitter_m=0.0)),
        "court-near": ("the same but for 0.5 m", partial(symmetric_court, jitter_m=0.5)),
        "court-confused": ("teams nearly point-symmetric, one camera takes each for the opponent",
                           partial(teams_confused, jitter_m=0.5)),
        "in-step": ("a crowd in step, identities found", partial(in_step, wander_m=0.0)),
        "in-step-near": ("the same but for 0.3 m", partial(in_step, wander_m=0.3)),
        "in-step-shifted": ("a crowd nearly in step, one camera takes each for the neighbour",
                            partial(in_step, wander_m=0.3, given=True, shifted=True)),
        "one-side-given": ("all people at one end of the area", partial(one_side, given=True)),
        "one-side-found": ("the same, identities found", partial(one_side, given=False)),
        "slope-5": ("ground of 5 % slope", partial(sloped, grade=0.05)),
        "slope-10": ("ground of 10 % slope", partial(sloped, grade=0.10)),
        "slope-10-found": ("the same, identities found", partial(sloped, grade=0.10, given=False)),
        "stairs": ("two levels, 1 m apart, with stairs", partial(stepped, height_m=1.0)),
        "stairs-found": ("the same, identities found", partial(stepped, height_m=1.0, given=False)),
        "children-given": ("children of 1.1 m, taken for adults", partial(children, given=True)),
        "children-found": ("the same, identities found", partial(children, given=False)),
        "mirror-wall": ("two cameras see everybody a second time in a wall of mirrors",
                        partial(looking_glass, cameras=("C1", "C2"))),
        "mirror-wall-all": ("all cameras do", partial(looking_glass, cameras=("C1", "C2", "C3", "C4"))),
        "screen-given": ("a screen in one view shows another camera's video", partial(big_screen, given=True)),
        "screen-found": ("the same, identities found", partial(big_screen, given=False)),
        "posters-given": ("posters in each view under the names of people", partial(posters, given=True)),
        "posters-found": ("posters in each view", partial(posters, given=False)),
        "two-people": ("two people only, 12 seconds", partial(staged, given=False, people=2, seconds=12.0)),
        "two-people-given": ("the same, identities given", partial(staged, people=2, seconds=12.0)),
        "three-seconds": ("three seconds", partial(staged, given=False, seconds=3.0)),
        "three-seconds-given": ("the same, identities given", partial(staged, seconds=3.0)),
    }
)  # fmt: skip
