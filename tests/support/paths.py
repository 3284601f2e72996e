"""Where things lie: the repository, its parts, and what may lie beside it."""

import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TESTS = ROOT / "tests"
DOCS = ROOT / "docs"
BENCHMARKS = ROOT / "benchmarks"
DATA = Path(os.environ.get("PASSERBY_DATA") or ROOT.parent / "shared" / "data")
"""The real data sets."""
MODELS = Path(os.environ.get("PASSERBY_MODELS") or ROOT.parent / "shared" / "models")
"""Real networks."""
