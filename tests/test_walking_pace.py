"""Walkers who are too fast are not as tall as they are taken to be; runners, strollers and bystanders say nothing."""

import numpy as np
import pytest

from passerby.walking_pace import doubts_of_pace, paces

FPS = 5.0


def ways(speeds: list[float], *, seconds: int = 30, scale: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Frames with identities, and places, of people who walk straight on."""
    frames = np.arange(1, int(seconds * FPS) + 1)
    keys, places = [], []
    for person, speed in enumerate(speeds):
        keys.append(np.column_stack([frames, np.full(len(frames), person)]))
        along = scale * speed * frames / FPS
        places.append(np.column_stack([along, np.full(len(frames), 2.0 * person), np.full(len(frames), 0.9)]))
    order = np.random.default_rng(0).permutation(len(speeds) * len(frames))
    return np.concatenate(keys)[order], np.concatenate(places)[order]


def test_paces_are_metres_per_second() -> None:
    pace = paces(*ways([1.2]), FPS)
    assert len(pace) == 145
    assert pace == pytest.approx(1.2)


def test_who_is_missing_a_second_later_has_no_pace() -> None:
    keys, places = ways([1.2, 0.9])
    early = keys[:, 0] <= 5
    assert len(paces(keys[early], places[early], FPS)) == 0


def test_children_taken_for_adults_are_told() -> None:
    speeds = [0.9, 1.0, 1.1, 1.2]
    assert doubts_of_pace(*ways(speeds), FPS) == []
    (told,) = doubts_of_pace(*ways(speeds, scale=1.72 / 1.1), FPS)
    assert "people walk at 1.6 m/s" in told
    assert "person_height_m" in told


def test_people_who_run_and_walk_say_nothing() -> None:
    assert doubts_of_pace(*ways([0.9, 1.2, 2.5, 3.0, 3.5]), FPS) == []


def test_people_who_stand_and_recordings_without_a_rate_say_nothing() -> None:
    assert doubts_of_pace(*ways([0.1, 0.0, 0.2]), FPS) == []
    assert doubts_of_pace(*ways([2.0, 2.1]), None) == []
