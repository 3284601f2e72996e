"""What other tools make of the files that Passerby writes for them, by the tools' own libraries.

One module a format, called as the format with `_` for `-`. It runs in an environment that holds the tool and numpy, not
Passerby, so it imports the tool inside `check`, and nothing but numpy and `format_tools.case` at its top. It has

    TOOL = "pycolmap"                    the distribution whose version the page tells
    ENVIRONMENT = "colmap"               `.venv-peer-colmap`; several formats may share one
    PACKAGES = ("pycolmap==4.2.1",)      what is installed there, in one go; each is pinned
    NEEDS = ()                           further packages, installed without pins before; often none
    WITHOUT = False                      True: PACKAGES are installed without what they depend on

    def check(folder: Path) -> float:

`check` reads what Passerby wrote (`Case.read(folder).target`, a file or a folder), projects `Case.world` with the tool and
gives the largest difference from `Case.pixels`, in OpenCV's pixels (`Case.largest`). Where the tool can write the format
itself, it writes what it has read to `Case.back`; Passerby reads that, and must have every point where it was.

`python benchmarks/formats.py` makes the environments, `python benchmarks/run.py --only formats` runs all modules here and
writes `docs/results/formats.md`, and `tests/benchmarks/format_tools/test_tools.py` those whose tool is installed.
"""
