"""`make pages`: write all pages of results from the records, without running anything.

`python benchmarks/write_pages.py PAGE/PART` prints all tables of a record.
"""

from __future__ import annotations

import argparse

from pages.records import RECORDS, read_record, record_path
from pages.render import part_text, write_pages


def main() -> None:
    """Write the pages, or print some records."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    names = sorted(path.relative_to(RECORDS).with_suffix("").as_posix() for path in RECORDS.rglob("*.json"))
    parser.add_argument("records", nargs="*", choices=[[], *names], metavar="PAGE/PART", help="print these records")
    asked = parser.parse_args().records
    for name in asked:
        record = read_record(record_path(RECORDS, *name.split("/")))
        print("" if record is None else part_text(record))
    if not asked:
        write_pages()


if __name__ == "__main__":
    main()
