"""The report of many cameras in a real browser, opened as a file: drawn, silent, and nothing loaded before it is asked for."""

import json
import shutil

import pytest

from passerby.findings.finding import doubt
from passerby.report.page import write_report
from support.accessibility import access_faults
from support.browser import CHROMIUM
from support.report.opened import OVERFLOW, PHONE, OpenedFile
from support.report.pages import HOSTILE, named
from support.report.sites import site

pytest.importorskip("playwright.sync_api", reason="no playwright: install the extra dev")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")

MANY = 64
SHOWN = "document.querySelector('#camera-view article')?.getAttribute('aria-label') === 'Camera {}'"
MAP = "document.getElementById('rig-above')"


@pytest.fixture(scope="session")
def contents():
    return site(MANY, problems=[doubt("few_observations", "cam-010", agreeing=3)], lost=["cam-007"])


@pytest.fixture(scope="session")
def folder(contents, tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    write_report(contents, folder / "report.html")
    return folder


@pytest.fixture
def opened(browser, folder):
    """Opens the report; fails at the end where it said anything, or fetched what is not of its folder."""
    pages = []

    def opens(path=folder / "report.html", **more):
        pages.append(OpenedFile(browser, path, **more))
        return pages[-1]

    yield opens
    for one in pages:
        assert one.said == []
        assert all(url.startswith(one.path.with_suffix("").as_uri()) for url in one.fetched)
        one.page.context.close()


def loaded(one):
    """Names of the files that a page has loaded."""
    return {url.rsplit("/", 1)[1] for url in one.fetched if url.endswith(".js")}


def see_map(one):
    """Scroll to the map, and wait for it."""
    one.told("document.getElementById('rig').scrollIntoView()")
    one.until(f"{MAP}.dataset.names !== undefined")


def test_nothing_is_loaded_before_it_is_asked_for_and_every_plot_is_drawn_once_it_is_seen(opened):
    one = opened()
    assert one.page.text_content("#verdict").endswith("Accepted")
    assert one.page.locator("#cameras-table tbody tr").count() == MANY
    before = loaded(one)
    assert not any(name.startswith("camera-") for name in before)
    assert "timeline-plot.js" not in before
    one.told("document.getElementById('views').scrollIntoView()")
    one.until(SHOWN.format("cam-001"))
    assert {name for name in loaded(one) if name.startswith("camera-")} == {"camera-0.js"}
    for name in ("rig-above", "rig-space", "timeline-plot", "heights-plot"):
        place = f"document.getElementById('{name}')"
        one.told(f"{place}.scrollIntoView()")
        one.until(f"{place}.dataset.drawn === 'yes' || {place}.classList.contains('plot-note')")
    assert one.page.locator("#timeline-plot .main-svg").count()
    assert one.page.locator("#rig-above .main-svg").count()


def test_a_camera_is_found_by_its_name_in_the_list_and_opened_by_keyboard(opened):
    one = opened()
    field = one.page.locator("input[data-filters=cameras-table]")
    field.focus()
    one.page.keyboard.type("CAM-03")
    visible = "Array.from(document.querySelectorAll('#cameras-table tbody tr:not([hidden]) .name'), (one) => one.textContent)"
    assert one.told(visible) == [f"cam-{number:03d}" for number in range(30, 40)]
    assert one.page.text_content("#cameras .search output") == f"10 of {MANY} rows"
    one.page.keyboard.type("3 good")
    assert one.told(visible) == ["cam-033"]
    link = one.page.locator("#cameras-table tbody tr:not([hidden]) a.name")
    link.focus()
    one.page.keyboard.press("Enter")
    one.until(SHOWN.format("cam-033"))
    assert one.told("document.activeElement.id") == "camera-view"
    assert one.page.input_value("#camera-name") == "cam-033"


def test_cameras_are_turned_over_and_asked_for_by_name_and_by_address(opened):
    one = opened()
    one.told("location.hash = '#camera=5'")
    one.until(SHOWN.format("cam-006"))
    one.page.uncheck("[data-layer=boxes]")
    one.page.get_by_role("button", name="Next camera").click()
    one.until(SHOWN.format("cam-007"))
    assert "not registered" in one.page.text_content("#camera-view")
    assert one.told("getComputedStyle(document.querySelector('.layer-boxes')).display") == "none", "of any camera"
    for _ in range(7):
        one.page.get_by_role("button", name="Previous camera").click()
    one.until(SHOWN.format(f"cam-{MANY:03d}"))  # before the first comes the last
    one.page.fill("#camera-name", "Cam-010")
    one.page.keyboard.press("Enter")
    one.until(SHOWN.format("cam-010"))
    assert "only 3 supporting observations" in one.page.text_content("#camera-view")
    one.page.fill("#camera-name", "nowhere")
    one.page.keyboard.press("Enter")
    assert one.page.text_content("#camera-note") == "No camera has this name."
    linked = opened(fragment="#camera=41")
    linked.until(SHOWN.format("cam-042"))


TYPED = """new MutationObserver(function (_, watcher) {{
    const field = document.getElementById("camera-name");
    if (!field || !({moment})) return;
    watcher.disconnect();
    field.focus();
    field.value = "{text}";
}}).observe(document, {{ childList: true, subtree: true }});"""
PARSED = """document.getElementById("camera-names")?.lastElementChild?.value === "cam-064"
    && document.getElementById("camera-view")"""


@pytest.mark.parametrize(("text", "given"), [("cam-012", True), ("cam-01", False)])
def test_a_name_that_is_given_before_the_script_runs_counts_and_one_that_is_being_typed_stays(opened, text, given):
    one = opened(before=TYPED.format(moment=PARSED, text=text))
    one.told("document.getElementById('views').scrollIntoView()")
    if not given:
        one.page.wait_for_timeout(500)
        assert one.page.input_value("#camera-name") == "cam-01"
        one.told("document.getElementById('camera-name').dispatchEvent(new Event('change'))")
    one.until(SHOWN.format("cam-012" if given else "cam-010"))
    assert not given or one.page.input_value("#camera-name") == "cam-012"


OVERLAPS = f"""() => {{
    const names = {MAP}.querySelectorAll('.scatterlayer .trace:last-child text');
    const boxes = Array.from(names, (one) => one.getBoundingClientRect());
    const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
    let count = 0;
    boxes.forEach((a, i) => boxes.slice(i + 1).forEach((b) => {{ count += meet(a, b) ? 1 : 0; }}));
    return [boxes.length, count];
}}"""


def test_names_stand_on_the_map_where_there_is_room_and_more_of_them_nearby(browser, tmp_path, opened):
    path = tmp_path / "report.html"
    write_report(site(160, seconds=4), path)
    one = opened(path)
    see_map(one)
    written, overlapping = one.told(OVERLAPS)
    assert overlapping == 0
    assert 20 < written < 160
    span = f"{MAP}._fullLayout.xaxis.range[1] - {MAP}._fullLayout.xaxis.range[0]"
    whole = one.told(span)
    one.page.get_by_label("Part of the map").select_option("2")
    one.until(f"{span} < {0.7 * whole}")
    inside = f"""(() => {{
        const {{ xaxis, yaxis }} = {MAP}._fullLayout, all = {MAP}.layout.meta.cameras;
        const within = (axis, value) => value > axis.range[0] && value < axis.range[1];
        return all.place.filter((_, row) => within(xaxis, all.x[row]) && within(yaxis, all.y[row])).length;
    }})()"""
    one.until(f"Number({MAP}.dataset.names) >= 0.6 * {inside}")
    assert one.told(OVERLAPS)[1] == 0
    nearby = one.told(span)
    one.page.get_by_role("button", name="Farther").first.click()
    one.until(f"{span} > {1.9 * nearby}")


def test_a_click_on_the_map_shows_the_camera(opened):
    one = opened()
    see_map(one)
    at = one.told(f"""() => {{
        const {{ xaxis, yaxis }} = {MAP}._fullLayout, all = {MAP}.layout.meta.cameras, box = {MAP}.getBoundingClientRect();
        const row = all.name.indexOf("cam-023");
        return [box.left + xaxis._offset + xaxis.l2p(all.x[row]), box.top + yaxis._offset + yaxis.l2p(all.y[row])];
    }}""")
    one.page.mouse.move(*at)
    one.page.mouse.click(*at)
    one.until(SHOWN.format("cam-023"))


def test_a_file_that_is_missing_or_damaged_is_told_where_it_would_be_shown(browser, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "copy")
    parts = next((tmp_path / "copy" / "report_files").iterdir())
    (parts / "camera-3.js").unlink()
    (parts / "camera-4.js").write_bytes((parts / "camera-4.js").read_bytes()[:200])
    one = OpenedFile(browser, tmp_path / "copy" / "report.html")
    for place in (3, 4):
        one.told(f"location.hash = '#camera={place}'")
        one.until(f"document.getElementById('camera-note').textContent.includes('camera-{place}.js is missing or damaged')")
        assert one.page.locator("#camera-view article").count() == 0
    one.told("location.hash = '#camera=5'")
    one.until(SHOWN.format("cam-006"))
    assert one.page.text_content("#camera-note") == ""
    one.page.context.close()


def test_axe_finds_nothing_serious_and_a_phone_never_scrolls_sideways(opened):
    for scheme in ("light", "dark"):
        one = opened(scheme=scheme, fragment="#camera=9")
        one.until(SHOWN.format("cam-010"))
        see_map(one)
        one.told("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
        assert access_faults(one.page) == [], scheme
    one = opened(size=PHONE, fragment="#camera=9", has_touch=True)
    one.until(SHOWN.format("cam-010"))
    see_map(one)
    assert one.told(OVERFLOW) == 0


def test_names_run_nothing_and_are_shown_as_they_are(opened, contents, tmp_path):
    path, names = tmp_path / "report.html", (*HOSTILE, "a/../b")
    write_report(named(contents, [*names, *contents.rig.names[len(names) :]]), path)
    one = opened(path)
    assert one.told("document.querySelectorAll('script:not([type=\"application/json\"]):not([src])').length") == 2
    shown = one.told("Array.from(document.querySelectorAll('#cameras-table tbody .name'), (one) => one.textContent)")
    assert set(names) <= set(shown)
    for place, name in enumerate(names):
        one.told(f"location.hash = '#camera={place}'")
        one.until(
            f"document.querySelector('#camera-view article')?.getAttribute('aria-label') === {json.dumps(f'Camera {name}')}"
        )
    see_map(one)
    assert one.told("document.querySelectorAll('main img').length") == 0
    handlers = "Array.from(document.querySelectorAll('*')).flatMap((one) => one.getAttributeNames())"
    assert not [name for name in one.told(handlers) if name.startswith("on")]
