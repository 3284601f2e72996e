"""The offset of two recordings by their sound: right to some milliseconds, or none."""

import wave
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from passerby.common.arrays import Floats
from passerby.perception.sound import HOP_S, listen, offset_by_sound
from passerby.perception.video import Piece, VideoInfo
from sources.sound import RATE, SoundCase, cases, simulated_pair, work
from support.scenes.numbered_videos import written as film_of_numbers

SHORT = (38.0, 42.0)


def info(path: Path) -> VideoInfo:
    return VideoInfo(path, (2, 2), "none", 25.0, False, 25.0, None, None)


def written(path: Path, sound: Floats) -> VideoInfo:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes((32767 * np.clip(sound, -1, 1)).astype("<i2").tobytes())
    return info(path)


@pytest.mark.slow
def test_common_sound_gives_the_offset_and_other_sound_none(tmp_path: Path) -> None:
    """Of fifty pairs none is wrong; two short ones are right to 5 ms, and have nothing in common."""
    shared, other = (work(SoundCase(seed, SHORT), tmp_path) for seed in (0, 1))
    assert (shared.shared, shared.wrong, other.shared, other.error_s) == (True, False, False, None)
    assert abs(shared.error_s) < 0.005
    outcomes = [work(case, tmp_path) for case in cases().values()]
    assert sum(one.shared and one.error_s is not None for one in outcomes) >= 23
    assert not any(one.wrong for one in outcomes)


def test_sound_that_repeats_is_ambiguous(tmp_path: Path) -> None:
    """A machine that knocks every second fits at every second."""
    rng = np.random.default_rng(0)
    knock = rng.standard_normal(400) * np.exp(-np.arange(400) / 80)
    beat = np.zeros(60 * RATE)
    for at in range(0, len(beat) - 400, RATE):
        beat[at : at + 400] = 0.3 * knock
    noise = 0.001 * rng.standard_normal((2, len(beat)))
    a, b = (listen(written(tmp_path / f"{k}.wav", beat + noise[k])) for k in range(2))
    assert offset_by_sound(a, b) is None


def test_sound_that_shows_nothing_or_is_missing_or_broken_is_named(tmp_path: Path) -> None:
    assert "silent" in listen(written(tmp_path / "one.wav", np.zeros(20 * RATE)))
    assert "only 3.0 s" in listen(written(tmp_path / "two.wav", 0.3 * np.random.default_rng(0).standard_normal(3 * RATE)))
    assert listen(info(film_of_numbers(tmp_path / "silent.mp4", 5))) is None
    (tmp_path / "broken.wav").write_bytes(b"RIFF" + bytes(3000))
    assert listen(info(tmp_path / "broken.wav")) == "its sound cannot be decoded"


def test_pieces_of_a_recording_lie_where_their_times_say(tmp_path: Path) -> None:
    """The same sound in one file, and in two; the first of these lacks its last three seconds."""
    a, b, lag_s = simulated_pair(SoundCase(2, SHORT))
    cut = 20 * RATE
    first, second = written(tmp_path / "b1.wav", b[: cut - 3 * RATE]), written(tmp_path / "b2.wav", b[cut:])
    pieces = (Piece(first.path, 7.0, None, 17.0), Piece(second.path, 27.0, None, 20.0))
    onsets = listen(replace(first, pieces=pieces))
    assert onsets.begin_s == pytest.approx(7.0, abs=0.1)
    assert len(onsets.values) * HOP_S == pytest.approx(len(b) / RATE, abs=0.2)
    found = offset_by_sound(listen(written(tmp_path / "a.wav", a)), onsets)
    assert found.lag_s == pytest.approx(lag_s + 7.0, abs=0.02)
    assert found.sigma_s >= 0.01
