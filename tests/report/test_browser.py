"""The page in a real browser: drawn, silent, offline, readable on a laptop and a phone, light and dark, by keyboard."""

import csv
import io
import json
from dataclasses import replace

import pytest

from passerby.core.usability import doubt_missing_pose
from passerby.findings.finding import notice, refusal
from passerby.interchange.storage.text_formats import plain
from passerby.report.contents import contents_from
from passerby.report.page import report_page
from support.accessibility import access_faults
from support.browser import CHROMIUM
from support.report.opened import OVERFLOW, PHONE, OpenedFile
from support.report.pages import HOSTILE, busy_place, changed, diagnosed, named, without_poses

pytest.importorskip("playwright.sync_api", reason="no playwright: install the extra dev")

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")

READABLE = 4.5
"""Least contrast of text (WCAG 2.2, 1.4.3)."""


@pytest.fixture(scope="session")
def contents(calibrated):
    return contents_from(calibrated[1])


class Opened(OpenedFile):
    """A page of contents, whose plots are drawn."""

    def __init__(self, browser, folder, contents, **more):
        path = folder / "page.html"
        path.write_text(report_page(contents), encoding="utf-8")
        super().__init__(browser, path, reduced_motion="no-preference", **more)
        self.settle()

    def settle(self):
        """Wait until all plots are drawn."""
        # Before the next picture the page has learnt of a change of the system's theme.
        self.told("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        self.until("document.documentElement.dataset.plots === 'drawn'")

    def theme(self, scheme):
        self.page.emulate_media(color_scheme=scheme)
        self.settle()

    def check_quiet(self):
        """Nothing was said, run or fetched, but the page itself."""
        assert self.said == []
        assert self.fetched == [self.path.as_uri()]


@pytest.fixture
def opened(browser, tmp_path):
    """Opens contents as a page, without WebGL, which takes seconds; fails at the end where it said or fetched anything."""
    pages = []

    def opens(contents, **more):
        pages.append(Opened(browser, tmp_path, contents, **more))
        return pages[-1]

    yield opens
    for one in pages:
        one.check_quiet()
        one.page.context.close()


@pytest.fixture(scope="session")
def shared(browser, contents, tmp_path_factory):
    """The accepted calibration on a laptop, opened once; tests leave it as they found it."""
    clipboard = ["clipboard-read", "clipboard-write"]
    one = Opened(browser, tmp_path_factory.mktemp("shared"), contents, webgl=True, permissions=clipboard)
    yield one
    one.page.context.close()


@pytest.fixture
def laptop(shared):
    yield shared
    shared.check_quiet()


def doubtful(contents):
    """The same contents, doubtful, with C2 lost."""
    lost = replace(contents.rig["C2"], pose=None, sigma=None)
    rig = replace(contents.rig, cameras=tuple(lost if one.name == "C2" else one for one in contents.rig))
    cameras = [plain(replace(one, centre_m=None) if one.name == "C2" else one) for one in contents.document.cameras]
    apart = doubt_missing_pose(notice("cameras_share_nobody", "C2", main=["C1"], given=True))
    odd = notice("frame_rate_missing", place="scene.toml")
    return replace(changed(contents, verdict="doubtful", cameras=cameras, **diagnosed(apart, odd)), rig=rig)


DRAWN = """() => Array.from(document.querySelectorAll(".plot"), (place) => [
    place.id, place.querySelectorAll(".main-svg").length,
    place.querySelectorAll("canvas, .scatterlayer .trace, .barlayer .point, .heatmaplayer image").length,
])"""


def colours(page, selector):
    """Colour of an element's text and of what lies behind it."""
    return page.evaluate(
        """(selector) => {
            const solid = (text) => text.match(/[\\d.]+/g).map(Number);
            const element = document.querySelector(selector);
            let behind = element, back = [0, 0, 0, 0];
            while (behind && back.length === 4 && back[3] === 0) {
                back = solid(getComputedStyle(behind).backgroundColor); behind = behind.parentElement;
            }
            return [solid(getComputedStyle(element).color).slice(0, 3), back.slice(0, 3)];
        }""",
        selector,
    )


def contrast(first, second):
    """WCAG's contrast of two colours, 0 to 255."""
    bright = []
    for colour in (first, second):
        linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (one / 255 for one in colour)]
        bright.append(0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2])
    return (max(bright) + 0.05) / (min(bright) + 0.05)


def test_every_plot_is_drawn_and_nothing_is_said_or_fetched(laptop):
    drawn = laptop.told(DRAWN)
    assert {name for name, _, _ in drawn} == {"rig-above", "rig-space", "timeline-plot", "heights-plot"}
    assert all(sheets and marks for _, sheets, marks in drawn)


def test_the_table_of_cameras_is_what_calibration_json_holds(laptop, calibrated):
    told = json.loads((calibrated[1] / "calibration.json").read_text())["cameras"]
    rows = laptop.told(
        """Array.from(document.querySelectorAll('#cameras-table tbody tr'),
            (row) => Array.from(row.cells, (cell) => cell.innerText))"""
    )
    for row, one in zip(rows, told, strict=True):
        places = [f"{round(value, 3) + 0.0:.3f}" for value in one["centre_m"]]
        sigmas = [f"{one[key]:.0f}" for key in ("points_sigma_mm", "ground_sigma_mm", "position_sigma_mm")]
        sigmas += [f"{one['orientation_sigma_deg']:.2f}"]
        turns = [f"{round(one[key], 1) + 0.0:.1f}" for key in ("heading_deg", "tilt_deg", "roll_deg")]
        seen = [f"{one['median_residual_px']:.1f}", str(one["people"]), str(one["boxes"])]
        assert [cell.strip() for cell in row] == [one["name"], *places, *turns, *sigmas, *seen]


@pytest.mark.parametrize("verdict", ["accepted", "refused"])
def test_a_phone_never_scrolls_sideways(opened, contents, verdict):
    shown = contents if verdict == "accepted" else without_poses(contents, refusal("nobody_seen_whole", "C1"))
    one = opened(shown, size=PHONE, has_touch=True)
    assert one.told(OVERFLOW) == 0
    one.told("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert one.told(OVERFLOW) == 0
    assert one.told("document.querySelector('#cameras .table-box').scrollWidth > innerWidth")  # there is something to scroll


@pytest.mark.parametrize("verdict", ["accepted", "doubtful", "refused"])
def test_text_is_readable_in_light_and_dark(opened, laptop, contents, verdict):
    shown = doubtful(contents) if verdict == "doubtful" else without_poses(contents, refusal("nobody_seen_whole", "C1"))
    one = laptop if verdict == "accepted" else opened(shown)
    selectors = [
        "#verdict", ".meaning", ".lead", ".key-figures dt", ".key-figures dd", "thead th", "tbody td", "tbody th", ".what",
        ".to-do", "button.quiet", ".pill", "nav a", "footer p", "summary", "code", ".stages li li",
        *{"accepted": [".note"], "doubtful": [".findings li", ".why"], "refused": [".nothing"]}[verdict],
    ]  # fmt: skip
    seen = {}
    for scheme in ("light", "dark"):
        one.page.emulate_media(color_scheme=scheme)
        seen[scheme] = {selector: colours(one.page, selector) for selector in selectors}
        assert not {which: contrast(*pair) for which, pair in seen[scheme].items() if contrast(*pair) < READABLE}
    one.page.emulate_media(color_scheme="light")
    one.settle()
    assert all(seen["light"][which] != seen["dark"][which] for which in selectors)


INK = "getComputedStyle(document.querySelector('#heights-plot .xtitle')).fill"


def test_the_switch_and_the_system_change_the_theme_of_page_and_plots(laptop):
    before = laptop.told(INK), colours(laptop.page, "#verdict")
    for _ in range(2):
        laptop.page.click("#theme")
        laptop.settle()
    assert laptop.page.text_content("#theme") == "Dark"
    assert "dark" in laptop.page.get_attribute("#theme", "aria-label")
    assert laptop.told(INK) != before[0]
    assert colours(laptop.page, "#verdict") != before[1]
    laptop.page.click("#theme")
    laptop.settle()
    assert laptop.page.text_content("#theme") == "Auto"
    assert (laptop.told(INK), colours(laptop.page, "#verdict")) == before
    laptop.page.emulate_media(color_scheme="dark")
    laptop.until(f"{INK} !== '{before[0]}'")
    laptop.settle()
    laptop.page.emulate_media(color_scheme="light")
    laptop.until(f"{INK} === '{before[0]}'")
    laptop.settle()


def column(page, number):
    """What a column of the table of cameras is sorted by."""
    return page.evaluate(
        f"Array.from(document.querySelectorAll('#cameras-table tbody tr'), (row) => row.cells[{number}].dataset.value)"
    )


def test_a_table_is_sorted_by_mouse_and_by_keyboard(opened, contents):
    page = opened(doubtful(contents)).page
    head = page.locator("#cameras-table thead th").nth(1)
    head.locator("button").click()
    values = column(page, 1)
    assert values[-1] == ""
    assert values[:-1] == sorted(values[:-1], key=float)
    assert head.get_attribute("aria-sort") == "ascending"
    head.locator("button").focus()
    page.keyboard.press("Enter")
    assert column(page, 1) == [*values[-2::-1], ""]
    assert head.get_attribute("aria-sort") == "descending"
    page.locator("#cameras-table thead th").nth(0).locator("button").click()
    assert column(page, 0) == ["C1", "C2", "C3", "C4"]
    assert head.get_attribute("aria-sort") == "none"


def test_a_table_is_copied_as_csv(laptop, contents):
    # It says so for two seconds only.
    laptop.told(
        """() => {
            const button = document.querySelector("[data-copies=cameras-table]");
            window.sayings = [];
            new MutationObserver(() => window.sayings.push(button.textContent)).observe(button, { childList: true });
        }"""
    )
    laptop.page.click("[data-copies=cameras-table]")
    laptop.until("window.sayings.length > 0")
    assert laptop.told("window.sayings[0]") == "Copied"
    rows = list(csv.DictReader(io.StringIO(laptop.told("navigator.clipboard.readText()"))))
    assert [row["Camera"] for row in rows] == list(contents.rig.names)
    assert [float(row["x m"]) for row in rows] == [one.centre_m[0] for one in contents.document.cameras]


def test_the_keyboard_reaches_everything(laptop):
    page = laptop.page
    wanted = laptop.told(
        """() => Array.from(document.querySelectorAll("a[href], button, input, select, summary, [tabindex='0']"))
            .filter((one) => one.checkVisibility())
            .map((one, number) => { one.dataset.number = number; return number; })"""
    )
    assert laptop.told("document.querySelector('[data-number=\"0\"]').className") == "skip"
    laptop.told("document.querySelector('.skip').focus()")
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Tab")
    assert laptop.told("document.activeElement.className") == "skip"
    assert laptop.told("document.activeElement.getBoundingClientRect().left") >= 0  # seen while it has the focus
    reached, outlines = set(), set()
    for _ in range(2 * len(wanted)):
        told = laptop.told("[document.activeElement.dataset.number, getComputedStyle(document.activeElement).outlineStyle]")
        if told[0] is None or reached == set(wanted):
            break
        reached.add(int(told[0]))
        outlines.add(told[1])
        page.keyboard.press("Tab")
    assert reached == set(wanted)
    assert "none" not in outlines  # where the focus is can be seen


def test_the_view_in_space_is_chosen_and_turned(laptop):
    eye = "JSON.stringify(document.getElementById('rig-space')._fullLayout.scene._scene.getCamera().eye)"
    seen = [laptop.told(eye)]
    views = laptop.page.get_by_label("View", exact=True)
    assert views.locator("option").count() >= 4
    for number in (1, 2, 3):
        views.select_option(str(number))
        laptop.until(f"{eye} !== '{seen[-1]}'")
        seen.append(laptop.told(eye))
    for name in ("Rotate left", "Nearer"):
        laptop.page.get_by_role("button", name=name).click()
        laptop.until(f"{eye} !== '{seen[-1]}'")
        seen.append(laptop.told(eye))
    assert len(set(seen)) == 6
    assert views.input_value() == ""
    views.select_option("0")
    laptop.until(f"{eye} !== '{seen[-1]}'")


def test_one_person_is_shown_in_the_timeline_and_layers_of_pictures_are_switched(laptop):
    drawn = "(() => { const bars = document.getElementById('timeline-plot').data.at(-1);"
    drawn += " return bars.customdata.map((told, row) => [told[0], bars.marker.opacity[row]]); })()"
    everybody = laptop.told(drawn)
    assert {who for who, opacity in everybody if opacity == 1} == {1, 2, 3, 4, 5}
    laptop.page.select_option("#timeline-person", "2")
    assert {who for who, opacity in laptop.told(drawn) if opacity == 1} == {2}
    laptop.page.select_option("#timeline-person", "")
    assert laptop.told(drawn) == everybody
    shown = "getComputedStyle(document.querySelector('.layer-boxes')).display"
    assert laptop.told(shown) != "none"
    laptop.page.uncheck("[data-layer=boxes]")
    assert laptop.told(shown) == "none"
    assert laptop.told("getComputedStyle(document.querySelector('.layer-grid')).display") != "none"
    laptop.page.check("[data-layer=boxes]")
    assert laptop.told(shown) != "none"


def test_without_webgl_a_note_stands_where_the_view_would_be_and_axe_finds_nothing_serious(opened, contents):
    one = opened(contents)
    assert "needs WebGL" in one.page.text_content("#rig-space")
    assert one.page.locator(".view-buttons").count() == 0
    assert one.page.locator("#rig-above .main-svg").count()
    for scheme in ("light", "dark"):
        one.theme(scheme)
        assert access_faults(one.page) == [], scheme


def test_names_run_nothing_and_are_shown_as_they_are(opened, contents):
    odd = diagnosed(doubt_missing_pose(notice("cameras_share_nobody", HOSTILE[1], main=[HOSTILE[2]], given=True)))
    one = opened(changed(named(contents, HOSTILE), name=HOSTILE[0], verdict="doubtful", **odd))
    names = one.told("Array.from(document.querySelectorAll('#cameras-table tbody .name'), (name) => name.textContent)")
    assert names == list(HOSTILE)
    assert one.told("document.querySelectorAll('img').length") == 0
    assert one.page.title().startswith(HOSTILE[0])
    labels = one.told("Array.from(document.querySelectorAll('#timeline-plot .ytick'), (tick) => tick.textContent)")
    assert any(label.startswith("<script>alert") for label in labels)


def test_a_busy_hour_is_drawn(opened):
    one = opened(busy_place(cameras=16, people=100, seconds=3600, fps=0.5))
    drawn = [name for name, sheets, marks in one.told(DRAWN) if sheets and marks]
    assert drawn == ["rig-above", "timeline-plot", "heights-plot"]
    assert one.told(OVERFLOW) == 0
    bars = "document.querySelectorAll('#timeline-plot .barlayer .point').length"
    assert one.told(bars) == 0  # how many at once, not thousands of bars
    one.page.select_option("#timeline-person", "7")
    assert one.told(bars) > 5


def test_paper_shows_what_is_folded_on_white(laptop):
    laptop.told("dispatchEvent(new Event('beforeprint'))")
    assert laptop.page.locator("details:not([open])").count() == 0
    laptop.told("dispatchEvent(new Event('afterprint'))")
    assert laptop.page.locator("details[open]").count() == 0
    laptop.page.emulate_media(media="print", color_scheme="dark")
    assert laptop.told("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    laptop.page.emulate_media(media="screen", color_scheme="light")
    laptop.settle()
