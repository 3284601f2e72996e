"""Chapters of a recording: in order, and at the times that their files state where these can be those of the pieces."""

from datetime import UTC, datetime
from pathlib import Path

import av
import numpy as np
import pytest

from passerby.perception.sources.files import VideoSource
from passerby.perception.sources.recording import open_source

BEGIN, FPS = 1_790_000_000, 10


def film(path: Path, seconds: int, created_s: int | None) -> None:
    path.parent.mkdir(exist_ok=True)
    with av.open(str(path), "w") as container:
        if created_s is not None:
            container.metadata["creation_time"] = f"{datetime.fromtimestamp(created_s, UTC):%Y-%m-%dT%H:%M:%S}.000000Z"
        video = container.add_stream("mpeg4", rate=FPS)
        video.width, video.height, video.pix_fmt = 32, 32, "yuv420p"
        for number in range(seconds * FPS):
            container.mux(video.encode(av.VideoFrame.from_ndarray(np.full((32, 32, 3), number % 200, np.uint8))))
        container.mux(video.encode())


def recorded(folder: Path, names: tuple[str, ...], created: tuple[int | None, ...]) -> tuple[list[float], set[str]]:
    """Where the pieces begin, and the codes of what is odd about them."""
    for number, (name, offset) in enumerate(zip(names, created, strict=True)):
        film(folder / name, 4 if number < len(names) - 1 else 2, None if offset is None else BEGIN + offset)
    found = open_source(VideoSource((folder,)), "a")
    assert [piece.path.name for piece in found.info.pieces] == list(names)
    return [piece.begin_s for piece in found.info.pieces], {finding.code for finding in found.findings}


NAMES = ("GX010012.MP4", "GX020012.MP4", "GX030012.MP4")


def test_chapters_of_a_makers_scheme_follow_at_once_and_one_that_is_missing_is_reported(tmp_path: Path) -> None:
    begins, codes = recorded(tmp_path / "whole", NAMES, (None, None, None))
    assert (begins, codes) == (pytest.approx([0.0, 4.0, 8.0]), set())
    assert recorded(tmp_path / "some", NAMES[::2], (None, None))[1] == {"pieces_untimed"}


@pytest.mark.parametrize(
    ("created", "shown", "told"),
    [
        ((0, 4, 60), [0.0, 4.0, 60.0], "recording_gaps"),
        *((times, [0.0, 4.0, 8.0], "pieces_untimed") for times in ((0, 0, 0), (300, 303, 305), (20, 10, 0), (0, 4, None))),
    ],
    ids=["a gap", "start", "copies", "back", "one"],
)
def test_creation_times_show_gaps_but_those_that_cannot_be_of_pieces_are_not_used(tmp_path, created, shown, told):
    begins, codes = recorded(tmp_path, ("walk_1.mp4", "walk_2.mp4", "walk_3.mp4"), created)
    assert (begins, codes) == (pytest.approx(shown, abs=0.6 if told == "recording_gaps" else 1e-6), {told})
