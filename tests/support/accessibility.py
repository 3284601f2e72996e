"""Faults of a page's accessibility, by axe-core."""

import pytest


def access_faults(page):
    """The serious and critical violations in a Playwright page as it stands, each as "rule: elements"."""
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="no axe-core: install the extra dev").Axe()
    return [
        f"{one['id']}: {', '.join(' '.join(node['target']) for node in one['nodes'])}"
        for one in axe.run(page).response["violations"]
        if one["impact"] in ("serious", "critical")
    ]
