"""Wall time of a stream's packets: by the sender where it tells it, by their arrival otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Source = Literal["sender", "arrival"]

SIGMA_S: dict[Source, float] = {"sender": 0.05, "arrival": 0.5}
"""Standard deviations: network cameras set their clocks by NTP; encoders and networks hold pictures back for up to a second."""
MOST_APART_S = 60.0
"""A sender whose clock differs by more from that of this computer has not been set."""


@dataclass(frozen=True)
class WallTime:
    """Maps seconds of a stream to seconds since 1970."""

    zero_s: float
    """The wall time of the stream's second 0."""
    source: Source

    @property
    def sigma_s(self) -> float:
        """One sigma."""
        return SIGMA_S[self.source]

    def at(self, stream_s: float) -> float:
        """Seconds since 1970."""
        return self.zero_s + stream_s


class WallClock:
    """Learns the wall time of one connection as packets arrive. A time once given stays, so that pieces fit each other."""

    def __init__(self) -> None:
        self._earliest: float | None = None
        self._given: WallTime | None = None
        self.unset_s: float | None = None
        """How far the sender's clock is from this computer's, where it is too far to be used."""

    def arrived(self, stream_s: float, arrival_s: float, sender_zero_s: float | None) -> None:
        """A packet of a second of the stream has arrived; the sender says when its second 0 was, or nothing.

        The packet that was held back the least tells the most, so the earliest of all zeros counts.
        """
        zero = arrival_s - stream_s
        self._earliest = zero if self._earliest is None else min(self._earliest, zero)
        if sender_zero_s is None or (self._given is not None and self._given.source == "sender"):
            return
        apart = sender_zero_s - self._earliest
        if abs(apart) <= MOST_APART_S:
            self._given = WallTime(sender_zero_s, "sender")
        else:
            self.unset_s = apart

    def settled(self) -> WallTime | None:
        """The mapping from now on; None before the first packet. A later word of the sender still replaces that by arrival."""
        if self._given is None and self._earliest is not None:
            self._given = WallTime(self._earliest, "arrival")
        return self._given
