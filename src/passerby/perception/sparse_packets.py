"""Packets of which only few pictures are wanted: groups of pictures that hold none of them are passed over undecoded.

A group begins with a key frame. Pictures that come after a key frame and are shown before it may need the group before it: they
are left out where that one was not decoded, and where one of them is wanted that one is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field

from av.packet import Packet
from av.video.stream import VideoStream

MOST_PACKETS = 3000
"""Of a group that is held back: where key frames are farther apart everything is decoded, so that the memory stays bounded."""


@dataclass(frozen=True)
class PassedOver:
    """Pictures that are not decoded; before the next packet the decoder starts anew."""

    last_s: float
    """Time of the last of them, in the stream's seconds."""


@dataclass(eq=False)
class _Group:
    """A key frame and what follows it, in the order of decoding."""

    packets: list[Packet[VideoStream]] = field(default_factory=list)

    @property
    def key_s(self) -> float:
        return _time(self.packets[0])

    def times(self, *, leading: bool) -> list[float]:
        """Of the pictures that are shown before the key frame, or of the others, ascending."""
        shown = [_time(packet) for packet in self.packets if not packet.is_discard]
        return sorted(time for time in shown if (time < self.key_s) == leading)

    def decodable(self, *, continuous: bool) -> list[Packet[VideoStream]]:
        """All packets, but for leading ones where the group before was not decoded."""
        return self.packets if continuous else [packet for packet in self.packets if _time(packet) >= self.key_s]

    def until(self, times: Collection[float], *, continuous: bool) -> list[Packet[VideoStream]]:
        """Of these the packets up to the last one of some pictures: none of those behind it is needed for them."""
        rest = self.decodable(continuous=continuous)
        return rest[: 1 + max(number for number, packet in enumerate(rest) if _time(packet) in times)]


def _time(packet: Packet[VideoStream]) -> float:
    assert packet.pts is not None
    assert packet.time_base is not None
    return float(packet.pts * packet.time_base)


def sparse(
    packets: Iterator[Packet[VideoStream] | None], is_wanted: Callable[[float], bool | None]
) -> Iterator[Packet[VideoStream] | PassedOver | None]:
    """The packets that are needed for the wanted pictures, and what is passed over between them.

    Args:
        packets: of a file, in order; None at the end of one that breaks off.
        is_wanted: of the time of a picture, asked once for each in the order in which they are shown; None while that cannot be
            stated yet: what was asked so far is decoded, and asked again.
    """
    held: _Group | None = None
    filling: _Group | None = None
    unasked: list[float] = []
    continuous = True
    early: list[float] = []
    """Wanted pictures that are shown before the key frame of the group that is settled next."""

    def asked(times: list[float]) -> list[float] | None:
        """Those that are wanted; None where that is not known yet."""
        unasked.extend(times)
        answers: list[float] = []
        while unasked:
            answer = is_wanted(unasked[0])
            if answer is None:
                return None
            time = unasked.pop(0)
            answers += [time] if answer else []
        return [time for time in answers if time in times]

    def settled(group: _Group, after: _Group | None) -> Iterator[Packet[VideoStream] | PassedOver]:
        nonlocal continuous, early
        own, early = early, []
        wanted = asked(group.times(leading=False))
        leading = asked(after.times(leading=True)) if after is not None else []
        early = leading or []
        if wanted is None or leading is None or leading:
            # Whole, so that what follows can use it.
            yield from group.decodable(continuous=continuous)
            continuous = True
        elif own or wanted:
            yield from group.until([*own, *wanted], continuous=continuous)
            yield PassedOver(_last(group))
            continuous = False
        else:
            yield PassedOver(_last(group))
            continuous = False

    for packet in packets:
        if packet is None or packet.size == 0:
            for group, after in ((held, filling), (filling, None)):
                if group is not None:
                    yield from settled(group, after)
            held = filling = None
            yield packet
            continue
        if packet.pts is None or packet.time_base is None or (filling is not None and len(filling.packets) >= MOST_PACKETS):
            for group in (held, filling):
                if group is not None:
                    yield from group.decodable(continuous=continuous)
                    continuous = True
            yield packet
            yield from packets
            return
        if filling is None and not packet.is_keyframe:
            yield packet
            continue
        if packet.is_keyframe:
            if held is not None:
                yield from settled(held, filling)
            held, filling = filling, _Group()
        assert filling is not None
        filling.packets.append(packet)


def _last(group: _Group) -> float:
    return max(_time(packet) for packet in group.packets)
