"""`python run_check.py MODULE RESULT FOLDER ...`: runs a check on each case, in the tool's own environment, and writes JSON."""

from __future__ import annotations

import importlib
import json
import sys
from importlib import metadata
from pathlib import Path

if __name__ == "__main__":
    # Checks are called as their tools often are: this folder must not stand before the tools, nor may its parent.
    sys.path[:] = [*sys.path[1:], str(Path(__file__).resolve().parents[1])]
    module = importlib.import_module(f"format_tools.{sys.argv[1]}")
    worst = [module.check(Path(folder)) for folder in sys.argv[3:]]
    Path(sys.argv[2]).write_text(json.dumps({"pixels": worst, "version": metadata.version(module.TOOL)}))
