"""Faults of a page's accessibility, by axe-core."""

from __future__ import annotations

from typing import Any

from axe_playwright_python.sync_playwright import Axe


def access_faults(page: Any) -> list[str]:
    """The serious and critical violations in a Playwright page as it stands, each as "rule: elements"."""
    found = Axe().run(page).response["violations"]
    return [
        f"{one['id']}: {', '.join(' '.join(node['target']) for node in one['nodes'])}"
        for one in found
        if one["impact"] in ("serious", "critical")
    ]
