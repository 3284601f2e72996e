"""The lenses that were estimated together with the rig: each number with its sigma, its prior, and what determined it."""

from __future__ import annotations

from passerby.core.field_of_view import field_of_view_deg
from passerby.core.lens_figures import LensFigures
from passerby.core.lens_parameters import LensParameter, lens_parameters, names_in_words
from passerby.report.camera_table import swatch
from passerby.report.contents import Contents
from passerby.report.html import Section, element, join
from passerby.report.tables import Cell, Column, data_table, number, text
from passerby.report.values import MISSING, figure, listed
from passerby.solver.refined_lenses import KNOWN_FOCAL

LEAD = (
    "The intrinsics of these cameras were estimated from the people, together with the rig; ± is one sigma. Compare them with "
    "the data sheets of your cameras, and check the horizon and the verticals in the camera views: the verticals must run "
    "along the edges of doors, posts and buildings."
)
COLUMNS = (
    Column("Camera", numeric=False),
    Column("Focal length", "px"),
    Column("Field of view", "° across"),
    Column("Field of view", "° down"),
    Column("Principal point", "x, px"),
    Column("Principal point", "y, px"),
    Column("Distortion", "k1"),
    Column("From people", numeric=False, hint="numbers that depend on the people more than on what was known before"),
    Column("From the prior", numeric=False, hint="numbers that depend on what was known before more than on the people"),
)
TERMS = (
    (
        "Focal length",
        "how much the lens magnifies: with twice the focal length a person appears twice as tall, and the image shows about "
        "half as much of the world.",
    ),
    ("Field of view", "how much of the world the image shows, as an angle. Data sheets of cameras state it."),
    (
        "Principal point",
        "the pixel at which the lens points. It is near the centre of the image, unless the image was cropped on one side.",
    ),
    (
        "Distortion k1",
        "how much the lens bends straight lines. Below 0 they bulge outwards towards the border, as with most wide-angle "
        "lenses; above 0 they bend inwards; at 0 they stay straight.",
    ),
    (
        "Prior",
        "what was known before anybody was seen: what the scene file states, or what lenses usually are. The fewer people a "
        "camera sees, the more the result depends on it.",
    ),
)
DETAILS = (
    Column("Camera", numeric=False),
    Column("Parameter", numeric=False),
    Column("Estimate"),
    Column("Std", hint="standard deviation (1 sigma)"),
    Column("Prior", hint="what was known before anybody was seen"),
    Column("Prior std", hint="standard deviation (1 sigma)"),
    Column("Std by people alone", hint="standard deviation without the prior"),
    Column("From people", "%", hint="share of what is known that comes from the people rather than from the prior"),
    Column("Determined by", numeric=False),
)


def lens_section(contents: Contents) -> Section | None:
    """The lenses that were estimated, one row a camera, then number by number; None where none was."""
    lenses = {name: parts for name, parts in contents.figures.lenses.items() if name in contents.rig.names}
    if not lenses:
        return None
    table = data_table("lenses-table", "Lenses", COLUMNS, [_row(contents, name, parts) for name, parts in lenses.items()])
    terms = element("dl", [join(element("dt", term), element("dd", words)) for term, words in TERMS], class_="terms")
    numbers = [(name, one) for name, parts in lenses.items() for one in lens_parameters(parts)]
    each = data_table("lens-priors-table", "Parameters of the lenses", DETAILS, [_detail(name, one) for name, one in numbers])
    folded = element("details", element("summary", "Each parameter, its prior, and what determined it"), each)
    notes = [element("p", sentence, class_="note") for sentence in _in_words(lenses)]
    return Section("lenses", "Lenses", LEAD, join(table, notes, folded, terms))


def _row(contents: Contents, name: str, parts: LensFigures) -> list[Cell]:
    """One camera. What was not estimated is as its intrinsics have it, without a sigma."""
    lens = contents.rig[name].lens
    across, down = field_of_view_deg(lens)
    by_name = {one.name: one for one in lens_parameters(parts)}
    k1 = float(lens.distortions[0]) if len(lens.distortions) else 0.0
    named = join(swatch(contents.rig.names.index(name)), element("span", name, class_="name"))
    return [
        text(named, name),
        _focal(by_name.get("focal length"), lens.focal),
        number(across, 0),
        number(down, 0),
        _estimate(by_name.get("principal point x"), float(lens.matrix[0, 2]), 0),
        _estimate(by_name.get("principal point y"), float(lens.matrix[1, 2]), 0),
        _estimate(by_name.get("distortion k1"), k1, 3),
        text(names_in_words([one for one in by_name.values() if one.people_share is not None and not one.by_prior]) or MISSING),
        text(names_in_words([one for one in by_name.values() if one.by_prior]) or MISSING),
    ]


def _focal(one: LensParameter | None, otherwise: float) -> Cell:
    """The focal length with its sigma in per cent; bold where it is known too little to rely on it."""
    if one is None:
        return number(otherwise, 0, kind="faint")
    share = one.sigma / one.estimate
    near = element("small", f" ± {100 * share:.1f} %")
    kind = "stands-out" if share > KNOWN_FOCAL else ""
    return Cell(join(figure(one.estimate, 0), near), one.estimate, kind, numeric=True)


def _estimate(one: LensParameter | None, otherwise: float, digits: int) -> Cell:
    """A number with its sigma; faint where it depends on its prior, or was not estimated."""
    if one is None:
        return number(otherwise, digits, kind="faint")
    near = element("small", f" ± {figure(one.sigma, digits)}")
    return Cell(join(figure(one.estimate, digits), near), one.estimate, "faint" if one.by_prior else "", numeric=True)


def _detail(name: str, one: LensParameter) -> list[Cell]:
    """One number of one camera."""
    digits = 1 if one.unit else 3
    return [
        text(name),
        text(f"{one.name}, {one.unit}" if one.unit else one.name),
        number(one.estimate, digits),
        number(one.sigma, digits),
        number(one.prior_value, digits),
        number(one.prior_sigma, digits),
        number(one.people_sigma, digits),
        _share(None if one.people_share is None else 100 * one.people_share),
        text(one.determined_by or MISSING),
    ]


def _share(percent: float | None) -> Cell:
    """A share as a bar with its figure."""
    if percent is None:
        return number(None)
    bar = element("span", class_="pull", style=f"width:{percent:.1f}%", aria_hidden="true")
    return Cell(join(element("span", bar, class_="pull-box"), figure(percent, 0)), percent, "pull-cell", numeric=True)


def _in_words(lenses: dict[str, LensFigures]) -> list[str]:
    """What is weakly determined, and which cameras have one lens."""
    out, numbers = [], {name: lens_parameters(parts) for name, parts in lenses.items()}
    poor = [name for name, all_of in numbers.items() if any(_poor(one) for one in all_of)]
    if poor:
        out.append(
            f"Bold: the focal length of {listed(poor)} is uncertain by more than {100 * KNOWN_FOCAL:.0f} %. State the field "
            "of view (hfov_deg), or record more people, near and far."
        )
    if any(one.by_prior for all_of in numbers.values() for one in all_of):
        out.append("Grey: people barely determine this number; it is close to what was known before.")
    groups: dict[str, list[str]] = {}
    for name, parts in lenses.items():
        if parts.group is not None:
            groups.setdefault(parts.group, []).append(name)
    out += [f"{listed(names)} have one lens, as the scene file states." for names in groups.values() if len(names) > 1]
    return out


def _poor(one: LensParameter) -> bool:
    """Whether it is a focal length that is known too little."""
    return one.name == "focal length" and one.sigma > KNOWN_FOCAL * one.estimate
