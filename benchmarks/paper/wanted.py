"""What the user asks of the parts of the benchmark."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Wanted:
    """What the user asks of the parts of the benchmark."""

    quick: bool = False
    """Few seeds and few levels: to see that all works, not to judge."""
    seeds: int | None = None
    """Seeds of each condition; None: as many as the part takes for its claims."""
    data: Path | None = None
    """Folder of the real data sets; None where there is none."""
    scenes: Path | None = None
    """Folder that keeps rendered videos for the next time; None: they are rendered anew."""
    kept: Path | None = None
    """Folder in which finished conditions are kept while the command runs, so that a stopped one goes on; None: nowhere."""
