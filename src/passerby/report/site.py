"""Reports of many cameras: when what one camera needs lies in files beside the page, and which cameras are neighbours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from passerby.common.arrays import Floats, Ints
from passerby.core.cameras import Rig
from passerby.core.colours import camera_colour
from passerby.report.contents import Contents
from passerby.report.seen import Seen

EMBEDDED_CAMERAS = 50
"""Most cameras of a report in one file: fifty pictures of 100 kB each beside plotly's code are 10 MB."""
ZONE_CAMERAS = 16
"""Most cameras of a zone that is not stated: so many names can be read in a part of the map."""
MOST_NEIGHBOURS = 16
"""Cameras whose people are drawn into a camera's picture, beside its own: an overlap of more is rare on a site."""


def is_site(contents: Contents) -> bool:
    """Whether the report has more cameras than fit into one file."""
    return len(contents.rig) > EMBEDDED_CAMERAS


def zones_of(contents: Contents) -> dict[str, int]:
    """The zone of each camera, from 1; by name, in the rig's order.

    Where the scene states groups of cameras ([sites] groups), a camera's zone is the first group that has it. Otherwise the
    map is halved across its longer side until no part has more than `ZONE_CAMERAS`; cameras without a pose have no zone then.
    """
    stated = _stated_groups(contents)
    if stated:
        found: dict[str, int] = {}
        for number, group in enumerate(stated, start=1):
            for name in group:
                found.setdefault(name, number)
        return {name: found[name] for name in contents.rig.names if name in found}
    posed = contents.rig.posed()
    parts = _halved(np.array([camera.centre[:2] for camera in posed]).reshape(-1, 2), np.arange(len(posed)))
    zone = {posed.names[row]: number for number, rows in enumerate(parts, start=1) for row in rows.tolist()}
    return {name: zone[name] for name in contents.rig.names if name in zone}


def zone_colour(zone: int) -> str:
    """`#rrggbb` of a zone, from 1."""
    return camera_colour(zone - 1)


def neighbours_of(rig: Rig, seen: Seen) -> Mapping[str, list[str]]:
    """By camera, those with poses that share most observations with it, at most `MOST_NEIGHBOURS`, the most first."""
    posed = set(rig.posed().names)
    shared: dict[str, list[tuple[int, str]]] = {name: [] for name in rig.names}
    for (first, second), both in seen.shared.items():
        if both.sightings and first in posed and second in posed:
            shared[first].append((both.sightings, second))
            shared[second].append((both.sightings, first))
    return {
        name: [other for _, other in sorted(found, key=lambda one: -one[0])[:MOST_NEIGHBOURS]] for name, found in shared.items()
    }


def _stated_groups(contents: Contents) -> Sequence[Sequence[str]]:
    """Groups of cameras that the scene file states; none where it states none."""
    sites = contents.document.scene.sites
    return (sites.groups if sites is not None else None) or ()


def _halved(places: Floats, rows: Ints) -> list[Ints]:
    """Rows of places (N, 2) in parts of at most `ZONE_CAMERAS`, neighbours together."""
    if len(rows) <= ZONE_CAMERAS:
        return [rows] if len(rows) else []
    own = places[rows]
    axis = int(np.argmax(own.max(axis=0) - own.min(axis=0)))
    order = rows[np.argsort(own[:, axis], kind="stable")]
    return [*_halved(places, order[: len(order) // 2]), *_halved(places, order[len(order) // 2 :])]
