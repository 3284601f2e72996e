"""View graph: the pairs of cameras that people connect, their evidence, and how well each pair agrees."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from passerby.core.association_figures import TiedPair, route_in_words
from passerby.core.colours import camera_colour
from passerby.core.figures import PairFigures, StarFigures
from passerby.core.overlap import Shared
from passerby.report.contents import Contents
from passerby.report.rendering import Row, Section, section
from passerby.report.seen import Seen
from passerby.report.tables import MISSING, Column, Table, count, number, text

STRONG, FAIR = 0.7, 0.4
"""Lowest confidence of a strong pair, and of a fair pair."""
MOST_WEAK = 200
"""Most pairs of a site that are listed."""
WIDTH, HEIGHT = 440.0, 400.0
"""Size of the picture in its own units: text of 13 units is still 11 pixels high on a phone."""


@dataclass(frozen=True)
class Link:
    """A pair of cameras."""

    first: str
    second: str
    shared: Shared
    agreeing: float | None = None
    """Share of the common observations that agree with one relative pose, 0 to 1; None if unknown."""
    support: float | None = None
    """Agreement of this pair with the poses through third cameras, 0 to 1; None if unknown."""
    routes: tuple[str, ...] = ()
    runner_up: float | None = None
    """Score of the second-best hypothesis, as a share of the score of the best; None if unknown."""
    offset_s: float | None = None
    used: bool = False

    @property
    def confidence(self) -> float | None:
        """Product of `agreeing` and `support`, or the known one of them; None if both are unknown."""
        known = [value for value in (self.agreeing, self.support) if value is not None]
        return float(np.prod(np.clip(known, 0.0, 1.0))) if known else None

    @property
    def word(self) -> str:
        """The confidence as a word."""
        if not self.used:
            return "not used"
        if self.confidence is None:
            return "used"
        return "strong" if self.confidence >= STRONG else "fair" if self.confidence >= FAIR else "weak"

    @property
    def kind(self) -> str:
        """The word as a class of the style sheet."""
        return self.word.replace(" ", "-")


def links_of(contents: Contents, seen: Seen) -> list[Link]:
    """Return all pairs that share observations or have figures of a stage, in the rig's order."""
    found = {pair: Link(*pair, shared) for pair, shared in seen.shared.items()}
    several, place = len(contents.rig) > 2, {name: index for index, name in enumerate(contents.rig.names)}
    for tied in contents.document.association.pairs or ():
        _update(found, place, tied.cameras, partial(_link_of_association, tied=tied, several=several))
    for guess in _guesses(contents):
        _update(found, place, guess.cameras, partial(_link_of_solver, guess=guess, several=several))
    links = (link for link in found.values() if link.shared.sightings or link.routes)
    return sorted(links, key=lambda link: (place[link.first], place[link.second]))


def _guesses(contents: Contents) -> Sequence[PairFigures]:
    """Return the solver's figures of its relative poses of pairs, for either method."""
    figures = contents.document.figures
    if not isinstance(figures, StarFigures):
        return contents.figures.pairs
    return [
        PairFigures(
            cameras=(figures.reference, arm.camera), route="essential matrix", inliers=arm.inliers, matches=arm.correspondences,
            support=None,
        )
        for arm in figures.pairs
    ]  # fmt: skip


def _update(
    found: dict[tuple[str, str], Link], place: Mapping[str, int], cameras: tuple[str, str], change: Callable[[Link], Link]
) -> None:
    """Change the link of two cameras of the rig, named in any order; `place` gives each camera's position in the rig."""
    if all(name in place for name in cameras) and cameras[0] != cameras[1]:
        pair = cameras if place[cameras[0]] < place[cameras[1]] else (cameras[1], cameras[0])
        found[pair] = change(found.get(pair) or Link(*pair, Shared(0, 0)))


def _link_of_association(link: Link, tied: TiedPair, several: bool) -> Link:
    """Return the link with the figures of association."""
    return replace(
        link,
        agreeing=tied.share,
        support=tied.support if several else None,
        routes=(tied.route,),
        runner_up=tied.runner_up,
        offset_s=tied.offset_s,
        used=tied.used,
    )


def _link_of_solver(link: Link, guess: PairFigures, several: bool) -> Link:
    """Return the link with the solver's figures instead of those of association; of several solver routes, the best counts."""
    share = guess.inliers / guess.matches if guess.matches else None
    new = replace(link, agreeing=share, support=guess.support if several else None, used=True)
    earlier = [name for name in link.routes if name in ("ground", "epipolar", "essential matrix")]
    routes = link.routes if guess.route in link.routes else (*link.routes, guess.route)
    better = not earlier or (new.confidence or 0.0) > (link.confidence or 0.0)
    return replace(new if better else link, routes=routes, used=True)


def view_graph_section(contents: Contents, seen: Seen) -> Section:
    """Return the section with the graph and the table of pairs."""
    links = links_of(contents, seen)
    edges, nodes = _draw_edges(contents, links), _draw_nodes(contents)
    return section(
        "graph", "View graph", site=False, table=pairs_table("pairs-table", contents, links), edges=edges, nodes=nodes,
        width=f"{WIDTH:.0f}", height=f"{HEIGHT:.0f}",
    )  # fmt: skip


def _place_nodes(contents: Contents) -> dict[str, tuple[float, float]]:
    """Return each camera's position on a circle, in the rig's order."""
    names = contents.rig.names
    angle = -np.pi / 2 + 2 * np.pi * np.arange(len(names)) / len(names)
    return {name: (WIDTH / 2 + 150 * np.cos(a), HEIGHT / 2 + 150 * np.sin(a)) for name, a in zip(names, angle, strict=True)}


def _draw_edges(contents: Contents, links: list[Link]) -> list[Row]:
    """Return a line for each pair; used pairs are drawn over unused ones."""
    at = _place_nodes(contents)
    most = max((link.shared.sightings for link in links), default=0) or 1
    widest = min(7.0, 40.0 / max(len(links), 1))  # thick lines of a rig of sixteen cameras would merge
    edges = []
    for link in sorted(links, key=lambda one: one.used):
        (x1, y1), (x2, y2) = at[link.first], at[link.second]
        title = (
            f"{link.first} – {link.second}: {link.word}, {link.shared.people} people, {link.shared.sightings} shared "
            f"observations"
        )
        width = f"{1.2 + widest * np.sqrt(link.shared.sightings / most):.1f}"
        place = {key: f"{value:.1f}" for key, value in (("x1", x1), ("y1", y1), ("x2", x2), ("y2", y2))}
        edges.append({**place, "width": width, "kind": link.kind, "title": title})
    return edges


def _draw_nodes(contents: Contents) -> list[Row]:
    """Return a disc for each camera, with its name outside the circle."""
    nodes = []
    for place, (name, (x, y)) in enumerate(_place_nodes(contents).items()):
        outwards = (x - WIDTH / 2, y - HEIGHT / 2)
        anchor = "middle" if abs(outwards[0]) < 40 else "start" if outwards[0] > 0 else "end"
        shift = (0.0, np.sign(outwards[1]) * 24) if anchor == "middle" else (np.sign(outwards[0]) * 16, 0.0)
        nodes.append({
            "name": name, "posed": contents.rig[name].pose is not None, "colour": camera_colour(place), "anchor": anchor,
            "x": f"{x:.1f}", "y": f"{y:.1f}", "text_x": f"{x + shift[0]:.1f}", "text_y": f"{y + shift[1]:.1f}",
            "short": name if len(name) <= 14 else name[:13] + "…",
        })  # fmt: skip
    return nodes


def weakest_links(links: Sequence[Link]) -> list[Link]:
    """Return the used links sorted by confidence, the weakest first; of equal ones, the link with the fewest observations."""
    used = [link for link in links if link.used]
    return sorted(used, key=lambda link: (2.0 if link.confidence is None else link.confidence, link.shared.sightings))


def site_graph_section(contents: Contents, links: list[Link]) -> Section:
    """Return the section with the pairs of a site that are most likely to be wrong; the map draws the pairs."""
    weakest = weakest_links(links)[:MOST_WEAK]
    told = f"{len(weakest)} of {count(sum(link.used for link in links), 'pair')} that are used."
    return section("graph", "Pairs", site=True, table=pairs_table("pairs-table", contents, weakest), listed=told)


def pairs_table(identifier: str, contents: Contents, links: Sequence[Link], *, copy: bool = True) -> Table:
    """Return a table with a row for each pair."""
    columns = [
        Column("Camera", numeric=False),
        Column("with", numeric=False),
        Column("Confidence", numeric=False, hint="product of inliers and loop consistency: strong from 70 %, fair from 40 %"),
        Column("People", hint="seen by both at the same time"),
        Column("Observations", hint="shared, at the same time"),
        Column("Inliers", "%", hint="share of the common observations that agree with one relative pose"),
        Column("Loop consistency", "%", hint="agreement with the poses through loops of other cameras"),
        Column(
            "Second-best", "%", hint="score of the second-best hypothesis, as a share of the best: high values are ambiguous"
        ),
        Column("Found by", numeric=False),
    ]
    place = {name: index for index, name in enumerate(contents.rig.names)}
    rows = []
    for link in links:
        rows.append(
            [
                text(link.first, colour=camera_colour(place[link.first])),
                text(link.second, colour=camera_colour(place[link.second])),
                text(link.word, inner=f"link-word {link.kind}"),
                number(link.shared.people, 0),
                number(link.shared.sightings, 0),
                number(_percent(link.agreeing), 0),
                number(_percent(link.support), 0),
                number(_percent(link.runner_up), 0),
                text(", ".join(map(route_in_words, link.routes)) or MISSING),
            ]
        )
    return Table(identifier=identifier, caption="Pairs of cameras", columns=columns, rows=rows, copy=copy)


def _percent(share: float | None) -> float | None:
    return None if share is None else 100 * share
