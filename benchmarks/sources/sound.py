"""Two recordings by their sound: simulated pairs with delay, reverberation and noise, and pairs without common sound."""

from __future__ import annotations

import time
import wave
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.signal import butter, fftconvolve, sosfilt

from passerby.common.arrays import Floats
from passerby.perception.sound import Onsets, listen, offset_by_sound
from passerby.perception.video import VideoInfo

RATE = 16000
SECONDS = (60.0, 180.0)
LARGEST_LAG_S = 40.0
REVERBERATION_S = (0.2, 1.2)  # time in which an echo falls by 60 dB
NOISE_DB = (-6.0, 20.0)  # of the sound over the noise of each microphone
LIMIT_S = 0.020


@dataclass(frozen=True)
class SoundCase:
    """One pair of recordings."""

    seed: int
    seconds: tuple[float, float] = SECONDS  # from and to: how long they are is drawn

    @property
    def shared(self) -> bool:
        """Whether both microphones hear the same; of every second pair they do not."""
        return self.seed % 2 == 0


@dataclass(frozen=True)
class SoundOutcome:
    """What became of it."""

    seed: int
    shared: bool
    error_s: float | None  # none where there is no answer; for pairs without common sound the answer itself

    @property
    def wrong(self) -> bool:
        """Whether there is an answer that is off by more than the limit, or where there is nothing to find."""
        return self.error_s is not None and (not self.shared or abs(self.error_s) > LIMIT_S)


def cases(count: int = 50) -> dict[str, SoundCase]:
    """The pairs by key; every second has no common sound."""
    return {f"{'common' if case.shared else 'nothing in common'} {case.seed}": case for case in map(SoundCase, range(count))}


def measured(case: SoundCase) -> dict[str, Any]:
    """What became of a pair: plain values."""
    began = time.process_time()
    with TemporaryDirectory() as folder:
        found = work(case, Path(folder))
    cpu_s = time.process_time() - began
    return {"about": {"shared": case.shared}, "cpu_s": cpu_s, "error_s": found.error_s, "wrong": found.wrong}


def work(case: SoundCase, folder: Path) -> SoundOutcome:
    """One pair: two files of sound are written into a folder and compared."""
    a, b, lag_s = simulated_pair(case)
    heard = [_heard(folder / f"{case.seed}{name}.wav", sound) for name, sound in (("a", a), ("b", b))]
    found = offset_by_sound(*heard)
    return SoundOutcome(case.seed, case.shared, None if found is None else found.lag_s - (lag_s if case.shared else 0.0))


def simulated_pair(case: SoundCase) -> tuple[Floats, Floats, float]:
    """What two microphones record, at `RATE`, and how much more the second one's clock shows, seconds."""
    rng = np.random.default_rng((case.seed, 77))
    seconds = rng.uniform(*case.seconds)
    lag_s = rng.uniform(-1.0, 1.0) * min(LARGEST_LAG_S, seconds / 3)
    length = round((seconds + abs(lag_s) + 1.0) * RATE)
    place = _scene(length, rng)
    other = place if case.shared else _scene(length, rng)
    # A later beginning shows less on its clock.
    begin_a, begin_b = max(0.0, lag_s), max(0.0, -lag_s)
    begin_b = round(begin_b * RATE) / RATE
    begin_a = begin_b + round(lag_s * RATE) / RATE
    heard = [_recorded(sound, begin, seconds, rng) for sound, begin in ((place, begin_a), (other, begin_b))]
    return heard[0], heard[1], begin_a - begin_b


def _scene(length: int, rng: np.random.Generator) -> Floats:
    """Steps, voices and knocks: bursts of noise in bands, some long and some short, over a murmur."""
    sound = 0.02 * rng.standard_normal(length)
    for _ in range(int(2.5 * length / RATE)):
        at, size = int(rng.integers(length)), int(RATE * rng.choice([0.03, 0.12, 0.5]) * rng.uniform(0.5, 1.5))
        size = min(size, length - at)
        low = rng.uniform(150, 1500)
        band = butter(2, [low, min(low * rng.uniform(1.5, 4.0), 6000)], btype="band", fs=RATE, output="sos")
        shape = np.exp(-np.arange(size) / max(1.0, 0.3 * size))
        sound[at : at + size] += rng.lognormal(-1.0, 0.7) * sosfilt(band, rng.standard_normal(size)) * shape
    return sound


def _recorded(sound: Floats, begin_s: float, seconds: float, rng: np.random.Generator) -> Floats:
    """What a microphone somewhere in the room records from a time on: direct sound, echoes, noise, its own gain."""
    first = round(begin_s * RATE)
    part = sound[first : first + round(seconds * RATE)]
    fall = rng.uniform(*REVERBERATION_S)
    times = np.arange(int(fall * RATE)) / RATE
    echo = rng.standard_normal(len(times)) * 10 ** (-3 * times / fall) * rng.uniform(0.01, 0.06)
    echo[0] = 1.0
    heard = fftconvolve(part, echo)[: len(part)]
    noise = rng.standard_normal(len(heard)) * heard.std() * 10 ** (-rng.uniform(*NOISE_DB) / 20)
    heard = heard + noise
    return np.asarray(heard / np.abs(heard).max() * rng.uniform(0.1, 0.9))


def _heard(path: Path, sound: Floats) -> Onsets:
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE)
        file.writeframes((32767 * sound).astype("<i2").tobytes())
    found = listen(VideoInfo(path, (2, 2), "none", 25.0, False, 25.0, None, None))
    assert isinstance(found, Onsets)
    return found
