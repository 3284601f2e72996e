"""A hook of mkdocs: adds the pages of reference that commands print too, and that are therefore not committed."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

MAKER = Path(__file__).resolve().parent / "make_reference.py"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add each page that `docs/make_reference.py` makes and does not write."""
    spec = importlib.util.spec_from_file_location("make_reference", MAKER)
    assert spec is not None
    assert spec.loader is not None
    maker = importlib.util.module_from_spec(spec)
    sys.modules["make_reference"] = maker
    spec.loader.exec_module(maker)
    for name, text in maker.pages().items():
        if name != maker.COMMITTED:
            files.append(File.generated(config, f"reference/{name}", content=text))
    return files
