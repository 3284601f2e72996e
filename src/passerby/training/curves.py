"""The record of a training: one row per epoch in log.csv, drawn in curves.html. It has no times, which differ in each run."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from passerby.common.errors import InputError
from passerby.common.text import shortened
from passerby.interchange.storage.atomic import write_text
from passerby.interchange.storage.safe_parsing import read_text
from passerby.interchange.storage.text_formats import csv_rows

LOG_FILE = "log.csv"
CURVES_FILE = "curves.html"


@dataclass(frozen=True)
class EpochRecord:
    """The results of an epoch: a row of the log."""

    epoch: int
    """Number of finished epochs, from 1."""
    step: int
    """Number of steps since the training began."""
    learning_rate: float
    """Learning rate of the epoch's last step."""
    loss: float
    """Weighted sum of both losses; losses are means over the epoch."""
    identity_loss: float
    """Identity loss without its weight."""
    triplet_loss: float
    """Triplet loss without its weight."""
    rank_1: float | None = None
    """Share of the searches whose first result is right, 0 to 1; None if the epoch was not validated."""
    map: float | None = None
    """Mean average precision, 0 to 1; None if the epoch was not validated."""


COLUMNS = tuple(field.name for field in fields(EpochRecord))
WHOLE = ("epoch", "step")
MAY_BE_EMPTY = ("rank_1", "map")


class TrainingLog:
    """`log.csv` in the folder of a run. After a killed process, only the last row may be missing."""

    def __init__(self, folder: Path) -> None:
        """Set up the log of the run in `folder`; the file need not exist yet."""
        self.path = folder / LOG_FILE

    def rows(self) -> tuple[EpochRecord, ...]:
        """Read all rows, the first epoch first; empty if there is no file.

        Raises `InputError` for a file that is not such a log.
        """
        if not self.path.exists():
            return ()
        header, lines = csv_rows(self.path, read_text(self.path, "the log of a training"))
        if tuple(header) != COLUMNS:
            raise InputError(
                f"{self.path}: line 1 is not {','.join(COLUMNS)}: this is not a log of a training; delete or move it"
            )
        rows: list[EpochRecord] = []
        for number, texts in lines:
            rows.append(self._row(texts, number))
            if len(rows) > 1 and rows[-1].epoch <= rows[-2].epoch:
                raise self._fault(number, f"epoch {rows[-1].epoch} comes after epoch {rows[-2].epoch}")
        return tuple(rows)

    def append(self, row: EpochRecord) -> None:
        """Add the row of an epoch. The file is replaced as a whole.

        Raises `InputError` if the epoch is not after the last one, the file is not such a log, or it cannot be written.
        """
        rows = self.rows()
        if rows and row.epoch <= rows[-1].epoch:
            raise InputError(
                f"{self.path}: has epoch {rows[-1].epoch} already, epoch {row.epoch} cannot follow it: delete the log"
            )
        self._write([*rows, row])

    def truncate_after(self, epoch: int) -> None:
        """Drop the rows after an epoch, if a training was killed before it wrote its checkpoint.

        Raises `InputError` if the file is not such a log, or cannot be written.
        """
        rows = self.rows()
        kept = [row for row in rows if row.epoch <= epoch]
        if len(kept) < len(rows):
            self._write(kept)

    def _write(self, rows: Iterable[EpochRecord]) -> None:
        """Write all rows; a number has as many digits as necessary to read the same number back."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(COLUMNS)
        for row in rows:
            writer.writerow([_text(name, getattr(row, name)) for name in COLUMNS])
        write_text(self.path, text.getvalue())

    def _row(self, texts: Sequence[str], line: int) -> EpochRecord:
        """Convert the texts of a line to a row. Raises `InputError` for any other line."""
        if len(texts) != len(COLUMNS):
            raise self._fault(line, f"{len(texts)} values instead of {len(COLUMNS)}")
        values: dict[str, Any] = {}
        for name, text in zip(COLUMNS, texts, strict=True):
            if not text and name in MAY_BE_EMPTY:
                continue
            try:
                values[name] = int(text) if name in WHOLE else float(text)
            except ValueError:
                raise self._fault(line, f"{name} is {shortened(text)}, not a number") from None
        return EpochRecord(**values)

    def _fault(self, line: int, what: str) -> InputError:
        return InputError(f"{self.path}: line {line}: {what}: fix the line, or delete the file (the training does not need it)")


def _text(name: str, value: float | None) -> str:
    """Return a value as text for the log; numpy's numbers are written as Python's."""
    if value is None:
        return ""
    return str(int(value)) if name in WHOLE else repr(float(value))


@dataclass(frozen=True)
class _Curve:
    """One line of a panel."""

    column: str
    name: str
    colour: str
    dash: str


# Distinguishable for people who see no red or no green (after Okabe and Ito 2008), and by dashes; contrast 3 : 1 against white
# and black.
_BLUE, _RED, _GREEN = "#3B82C4", "#D55E00", "#009E73"
PANELS: tuple[tuple[str, str, tuple[_Curve, ...]], ...] = (
    (
        "Loss, mean over an epoch",
        "loss",
        (
            _Curve("loss", "total, weighted", _BLUE, "solid"),
            _Curve("identity_loss", "identity", _RED, "dash"),
            _Curve("triplet_loss", "triplet", _GREEN, "dot"),
        ),
    ),
    (
        "Validation: people found again",
        "share",
        (_Curve("rank_1", "rank-1", _BLUE, "solid"), _Curve("map", "mAP", _RED, "dash")),
    ),
    (
        "Learning rate of the last step of an epoch",
        "learning rate",
        (_Curve("learning_rate", "learning rate", _BLUE, "solid"),),
    ),
)

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>Training of a re-identification network</title>
<style>
:root {{ --paper: #ffffff; --ink: #1f2328; --grid: #d9dde2; }}
@media (prefers-color-scheme: dark) {{ :root {{ --paper: #15181c; --ink: #e6e8eb; --grid: #3a4048; }} }}
body {{ background: var(--paper); color: var(--ink); font: 16px/1.5 system-ui, sans-serif; margin: 1.5rem auto;
       max-width: 60rem; padding: 0 1rem; }}
h1 {{ font-size: 1.4rem; margin: 0; }}
h2 {{ font-size: 1.05rem; margin: 1.5rem 0 0; }}
p {{ margin: 0.3rem 0; }}
.main-svg {{ background: transparent !important; }}
.xtick text, .ytick text, .xtitle, .ytitle, .infolayer .legendtext {{ fill: var(--ink) !important; }}
.gridlayer path, .zerolinelayer path {{ stroke: var(--grid) !important; }}
</style>
</head>
<body>
<h1>Training of a re-identification network</h1>
<p>{summary}</p>
{panels}
</body>
</html>
"""


def write_curves(log: TrainingLog, path: Path) -> None:
    """Draw a log: losses, rank-1 and mAP, learning rate over the epochs, on one page that needs no network connection.

    The same log gives the same bytes. Raises `InputError` if the log is not valid, or the page cannot be written.
    """
    rows = log.rows()
    panels = []
    for number, (title, unit, curves) in enumerate(PANELS):
        panels.append(f"<h2>{title}</h2>\n{_draw_panel(rows, number, unit, curves)}")
    write_text(path, _PAGE.format(summary=_summary(rows), panels="\n".join(panels)))


def _summary(rows: Sequence[EpochRecord]) -> str:
    """Return the state of the training in one or two sentences."""
    if not rows:
        return "No epoch is finished yet."
    told = f"After epoch {rows[-1].epoch}, {rows[-1].step} steps: loss {rows[-1].loss:.4g}."
    scored = [(row.rank_1, row.epoch) for row in rows if row.rank_1 is not None]
    if not scored:
        return f"{told} Not validated."
    best, epoch = max(scored, key=lambda score: score[0])
    return f"{told} Best rank-1 {best:.3f} after epoch {epoch}, {scored[-1][0]:.3f} at the last validation."


def _draw_panel(rows: Sequence[EpochRecord], number: int, unit: str, curves: Sequence[_Curve]) -> str:
    """Draw one panel as HTML; the first one includes plotly's script, 5 MB."""
    from plotly import graph_objects
    from plotly.io import to_html

    figure = graph_objects.Figure()
    for curve in curves:
        points = [(row.epoch, getattr(row, curve.column)) for row in rows if getattr(row, curve.column) is not None]
        # A curve with few points, as of the validations, has markers.
        mode = "lines+markers" if len(points) <= 40 else "lines"
        figure.add_scatter(
            x=[epoch for epoch, _ in points],
            y=[value for _, value in points],
            name=curve.name,
            mode=mode,
            line={"color": curve.colour, "dash": curve.dash, "width": 2},
            hovertemplate="%{y:.4g}",
        )
    last = max(rows[-1].epoch, 2) if rows else 2
    figure.update_layout(
        template="none",
        height=300,
        margin={"l": 90, "r": 20, "t": 36, "b": 50},
        paper_bgcolor="rgba(0,0,0,0)",
        plot_bgcolor="rgba(0,0,0,0)",
        hovermode="x unified",
        hoverlabel={"bgcolor": "#ffffff", "font": {"color": "#1f2328"}},
        showlegend=len(curves) > 1,
        legend={"orientation": "h", "x": 0, "y": 1.02, "yanchor": "bottom", "bgcolor": "rgba(0,0,0,0)"},
        font={"size": 13},
    )
    figure.update_xaxes(title="epoch", range=[0.5, last + 0.5], hoverformat="epoch %{x}", zeroline=False)
    figure.update_yaxes(
        title={"text": unit, "standoff": 14}, automargin=True, rangemode="tozero", exponentformat="power", zeroline=False
    )
    if unit == "share":
        figure.update_yaxes(range=[0, 1.02], dtick=0.2)
    return str(
        to_html(
            figure,
            config={"displayModeBar": False, "responsive": True},
            include_plotlyjs=number == 0,
            full_html=False,
            div_id=f"curves-{number}",
            default_height="300px",
        )
    )
