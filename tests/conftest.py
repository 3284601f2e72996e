"""What all tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

# The same examples on every machine, and no example fails because a machine is slow.
settings.register_profile("passerby", deadline=None, derandomize=True)
settings.load_profile("passerby")


@pytest.fixture(scope="session")
def data_root() -> Path:
    """The folder of the real data sets; the test is skipped where there is none."""
    named = os.environ.get("PASSERBY_DATA")
    root = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    if not root.is_dir():
        pytest.skip(f"no real data: {root} does not exist; set PASSERBY_DATA to their folder")
    return root
