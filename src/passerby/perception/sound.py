"""Clock offset of two recordings from their sound.

A recording's sound is converted to onsets in some frequency bands, every few milliseconds: reverberation, gain and noise change
them little, and they need little memory. Their cross-correlation over all lags has one narrow peak if both recorded the same
sound, and none if not. Sound travels 1 m in 3 ms, so the distances limit the accuracy of an offset.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import gaussian_filter1d

from passerby.common.arrays import Floats
from passerby.perception.video import VideoInfo

Singles = NDArray[np.float32]

RATE = 8000
"""Sampling rate of the sound, Hz: voices and steps are below 4 kHz."""
HOP_S, WINDOW = 0.008, 256
"""Time between two onset values, and number of samples that each uses (32 ms)."""
BANDS_HZ = (150.0, 350.0, 600.0, 950.0, 1450.0, 2200.0, 3600.0)
"""Edges of the bands. Hum and wind are below; frequencies that codecs remove are above."""
LONGEST_S = 7200.0
"""Longest used part of a recording: two hours take 25 MB."""
QUIET = 1e-4
"""Root mean square, full scale 1, below which a recording is silent: codecs and converters make noise of about 1e-5."""
HEARD_S = 10.0
"""Less sound gives no information."""
TREND_HOPS = 60.0
"""Standard deviation, in hops (half a second), of the Gaussian filter for the slow changes that are subtracted."""
LARGEST_ONSET = 3.0
"""Limit in standard deviations: one slammed door must not outweigh an hour of steps."""
LEAST_OVERLAP_S = 20.0
"""Recordings that overlap by less are not compared."""
CLEAR_SIGNIFICANCE, CLEAR_SECOND = 10.0, 0.6
"""A peak is significant if it is this number of standard deviations of the values at other lags above them, and the next peak
has at most this share of it: repeated sounds, such as those of machines, have many similar peaks. In 25 simulated pairs without
common sound the best peak had 5.6, in 25 with common sound the least had 27 (`benchmarks/sources/sound.py`, seeds 0 to 49)."""
SAME_PEAK_S = 0.25
"""Peaks within this distance are one: echoes."""
SPREAD_LAGS = 4000
PARTS = 4
"""Number of parts of the overlap whose lags are compared, which shows clocks that drift apart."""
PART_REACH_S = 0.5
TRAVEL_SIGMA_S = 0.010
"""Standard deviation of the error from the path of the sound: distances of cameras from the source differ by some 3 m."""


@dataclass(frozen=True, eq=False)
class Onsets:
    """Onsets in the sound of a recording, over even steps of `HOP_S`."""

    begin_s: float
    """Time of the first row, seconds from the first picture."""
    values: Singles
    """(N, B) onsets in each band, mean 0, of unit variance."""


@dataclass(frozen=True)
class SoundOffset:
    """Offset of the clocks of two recordings, from their sound."""

    lag_s: float
    """Time by which the second recording's clock is ahead."""
    sigma_s: float
    significance: float
    """Distance of the peak from the values at other lags, in their standard deviations."""


def listen(info: VideoInfo) -> Onsets | str | None:
    """Compute the onsets in a video's sound, with bounded memory. None without sound; the reason, a clause, for useless sound.

    Broken parts count as silence.
    """
    energies: list[Singles] = []
    begin: float | None = None
    heard = total = 0.0
    try:
        for second, samples in _join_blocks(_decode_samples(info)):
            begin = second if begin is None else begin
            energies.append(_energies(samples))
            # The part with which the next block begins is not counted twice.
            fresh = samples[: len(samples) - WINDOW + round(HOP_S * RATE)]
            heard += float((fresh.astype(np.float64) ** 2).sum())
            total += len(fresh)
            if total / RATE >= LONGEST_S:
                break
    except _NoSoundError:
        return None
    except (FFmpegError, OSError, ValueError):
        return "its sound cannot be decoded"
    if begin is None or total / RATE < HEARD_S:
        return f"it has only {total / RATE:.1f} s of sound"
    if np.sqrt(heard / total) < QUIET:
        return "its sound is silent"
    return Onsets(begin + 0.5 * WINDOW / RATE, _onsets(np.concatenate(energies)))


def has_sound(info: VideoInfo) -> bool:
    """Check whether the first file of a video has an audio stream; no sound is decoded."""
    try:
        with av.open(str(info.files[0])) as container:
            return bool(container.streams.audio)
    except (FFmpegError, OSError, ValueError):
        return False


class _NoSoundError(Exception):
    """A file has no audio stream."""


def _decode_samples(info: VideoInfo) -> Iterator[tuple[float, Singles]]:
    """Yield the time from the first picture, and samples of one channel at `RATE`, in order."""
    parts = [(piece.path, piece.begin_s) for piece in info.pieces] or [(info.path, 0.0)]
    for path, begin in parts:
        yield from _read_file(path, begin)


def _read_file(path: Path, begin: float) -> Iterator[tuple[float, Singles]]:
    with av.open(str(path)) as container:
        if not container.streams.audio:
            raise _NoSoundError
        first = 0.0
        for video in container.streams.video[:1]:
            if video.start_time is not None and video.time_base is not None:
                first = float(video.start_time * video.time_base)
        resampler = av.AudioResampler(format="flt", layout="mono", rate=RATE)
        at: float | None = None
        for packet in container.demux(container.streams.audio[0]):
            try:
                frames = packet.decode()
            except FFmpegError:
                continue
            for frame in frames:
                if frame.pts is not None and frame.time_base is not None:
                    stamp = float(frame.pts * frame.time_base) - first
                    # Timestamps of small containers are rounded; only missing sound moves the samples.
                    at = stamp if at is None or abs(stamp - at) > 2 * HOP_S else at
                at = 0.0 if at is None else at
                frame.pts = None
                for part in resampler.resample(frame):
                    samples = np.asarray(part.to_ndarray(), dtype=np.float32).reshape(-1)
                    yield begin + at, samples
                    at += len(samples) / RATE


def _join_blocks(parts: Iterator[tuple[float, Singles]]) -> Iterator[tuple[float, Singles]]:
    """Yield blocks of samples without gaps, of whole windows; the next block begins with the samples left by the last one.

    Missing time is silence; sound that comes too early is left out. The time is that of the block's first sample, seconds.
    """
    hop = round(HOP_S * RATE)
    origin: float | None = None
    held: list[Singles] = []
    count = done = 0
    for second, samples in parts:
        origin = second if origin is None else origin
        missing = round((second - origin) * RATE) - done
        if missing > hop:
            missing = min(missing, round(LONGEST_S * RATE))
            held.append(np.zeros(missing, dtype=np.float32))
        elif missing < -hop:
            samples = samples[-missing:]
            missing = 0
        else:
            missing = 0
        held.append(samples)
        done += missing + len(samples)
        count += missing + len(samples)
        if count >= 10 * RATE:
            block = np.concatenate(held)
            used = (len(block) - WINDOW) // hop * hop
            yield origin + (done - count) / RATE, block[: used + WINDOW]
            held, count = [block[used + hop :]], len(block) - used - hop
    if count >= WINDOW and origin is not None:
        block = np.concatenate(held)
        used = (len(block) - WINDOW) // hop * hop
        yield origin + (done - count) / RATE, block[: used + WINDOW]


def _energies(samples: Singles) -> Singles:
    """Compute the logarithm of the energy in each band, window after window, (N, B)."""
    hop = round(HOP_S * RATE)
    windows = np.lib.stride_tricks.sliding_window_view(samples, WINDOW)[::hop] * np.hanning(WINDOW).astype(np.float32)
    power = np.abs(rfft(windows, axis=1)) ** 2
    edges = np.round(np.array(BANDS_HZ) * WINDOW / RATE).astype(np.int64)
    bands = np.add.reduceat(power, edges, axis=1)[:, :-1]
    # The floor is that of the quietest recording that is used.
    return np.asarray(np.log(bands + QUIET**2 * WINDOW), dtype=np.float32)


def _onsets(energy: Singles) -> Singles:
    """Compute the rise of energy in each band, (N, B): reverberation prolongs a sound, and moves its beginning little."""
    rise = np.maximum(np.diff(gaussian_filter1d(energy, 1.0, axis=0), axis=0, prepend=energy[:1]), 0.0)
    rise -= gaussian_filter1d(rise, TREND_HOPS, axis=0)
    spread = rise.std(axis=0)
    rise = np.clip(rise / np.where(spread > 0, spread, 1.0), -LARGEST_ONSET, LARGEST_ONSET)
    return np.asarray(rise - rise.mean(axis=0), dtype=np.float32)


def offset_by_sound(a: Onsets, b: Onsets) -> SoundOffset | None:
    """Estimate the offset of two recordings' clocks; None where no peak is significant."""
    n_a, n_b = len(a.values), len(b.values)
    shift = np.arange(-(n_a - 1), n_b)
    overlap = np.minimum(n_a, n_b - shift) - np.maximum(0, -shift)
    long = overlap >= LEAST_OVERLAP_S / HOP_S
    if not long.any():
        return None
    shift, overlap = shift[long], overlap[long]
    value = _standardise(_correlation(a.values, b.values)[shift] / np.sqrt(overlap))
    best = int(np.argmax(value))
    apart = np.abs(shift - shift[best]) > SAME_PEAK_S / HOP_S
    second = float(value[apart].max(initial=0.0))
    if value[best] < CLEAR_SIGNIFICANCE or second > CLEAR_SECOND * value[best]:
        return None
    lags = _lags_of_parts(a.values, b.values, int(shift[best]))
    lag = float(shift[best]) + _vertex(value, best) if not len(lags) else float(np.median(lags))
    drift = float(np.median(np.abs(lags - lag))) * HOP_S if len(lags) else 0.0
    sigma = float(np.hypot(TRAVEL_SIGMA_S, drift))
    return SoundOffset(lag * HOP_S + b.begin_s - a.begin_s, sigma, float(value[best]))


def _correlation(a: Singles, b: Singles) -> Floats:
    """Return the whitened cross-correlation (length,), summed over the bands, by shift, which may be negative."""
    length = next_fast_len(len(a) + len(b), real=True)
    crossed = np.zeros(length // 2 + 1, dtype=np.complex64)
    for band in range(a.shape[1]):
        crossed += _whiten_spectrum(rfft(a[:, band], length)).conj() * _whiten_spectrum(rfft(b[:, band], length))
    return np.asarray(irfft(crossed, length), dtype=np.float64)


def _whiten_spectrum(transformed: NDArray[np.complex64]) -> NDArray[np.complex64]:
    """Divide a spectrum by its usual amplitude at each frequency: rhythms of steps and machines count no more than others."""
    usual = gaussian_filter1d(np.abs(transformed), max(1.0, len(transformed) / 200.0))
    return np.asarray(transformed / np.maximum(usual, 1e-6), dtype=np.complex64)


def _standardise(value: Floats) -> Floats:
    """Convert values (N,) to standard deviations of the values at neighbouring lags."""
    blocks = np.array_split(np.arange(len(value)), max(1, len(value) // SPREAD_LAGS))
    centre = np.array([block.mean() for block in blocks])
    middle = np.array([np.median(value[block]) for block in blocks])
    spread = np.array([1.4826 * np.median(np.abs(value[block] - m)) for block, m in zip(blocks, middle, strict=True)])
    at = np.arange(len(value))
    return np.asarray((value - np.interp(at, centre, middle)) / np.maximum(np.interp(at, centre, spread), 1e-12))


def _lags_of_parts(a: Singles, b: Singles, shift: int) -> Floats:
    """Return the lags (P,) of parts of the overlap, hops, near that of the whole."""
    first, last = max(0, -shift), min(len(a), len(b) - shift)
    reach = round(PART_REACH_S / HOP_S)
    size = (last - first) // PARTS
    if size < LEAST_OVERLAP_S / HOP_S:
        return np.zeros(0)
    found = []
    for begin in range(first, first + PARTS * size, size):
        low = max(0, begin + shift - reach)
        part = _correlation(a[begin : begin + size], b[low : begin + shift + size + reach])
        lags = np.arange(-reach, reach + 1) + begin + shift - low
        near = part[lags]
        best = int(np.argmax(near))
        found.append(best - reach + shift + _vertex(near, best))
    return np.array(found)


def _vertex(value: Floats, best: int) -> float:
    """Return the vertex of the parabola through the best value and its neighbours, relative to the best one."""
    if not 0 < best < len(value) - 1:
        return 0.0
    before, at, after = value[best - 1 : best + 2]
    bend = before - 2 * at + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0 else 0.0
