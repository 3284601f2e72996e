"""The files of a report of many cameras: the page shows them in the report, which runs apart from it, and serves no others."""

import shutil

import pytest

from passerby.interchange.calibration_json import CalibrationDocument, write_document
from passerby.interchange.output_folder import report_folder
from passerby.report.page import write_report
from support.browser import CHROMIUM
from support.report.sites import site


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    page = tmp_path_factory.mktemp("site") / "report.html"
    write_report(site(56, seconds=4), page)
    return page


@pytest.fixture
def files(session, written):
    """Names of the folder and of its files below the address."""
    shutil.copy(written, session.out / "report.html")
    shutil.copytree(report_folder(written), report_folder(session.out / "report.html"))
    (stamped,) = report_folder(session.out / "report.html").iterdir()
    (stamped / "secret.txt").write_text("mine")
    (stamped.parent / "secret.js").write_text("mine")
    return stamped.name


def test_the_files_are_served_without_the_token_that_the_report_does_not_have(client, files):
    answer = client.get(f"/report_files/{files}/camera-3.js", cookie=None, origin="null")
    assert answer.status == 200
    assert answer.body.startswith(b'passerbyPart("camera-3",')
    assert answer.headers["content-type"].startswith("text/javascript")
    assert answer.headers["cross-origin-resource-policy"] == "cross-origin"
    assert answer.headers["x-content-type-options"] == "nosniff"


NOT_SERVED = (
    "{}/secret.txt", "secret.js", "{}/../secret.js", "{}/%2e%2e/secret.js", "../report.html", "..%2fcamera-3.js", "{}/",
    "0123456789abcdef/camera-3.js", "{}/camera-99.js",
)  # fmt: skip


@pytest.mark.parametrize("path", NOT_SERVED)
def test_nothing_else_is_served_there(client, files, path):
    assert client.get("/report_files/" + path.format(files), cookie=None).status == 404


def test_other_methods_and_hosts_are_turned_away_there_too(client, files):
    path = f"/report_files/{files}/camera-3.js"
    assert client.ask("POST", path, cookie=None)[0].status == 403
    assert client.get(path, host="evil.example").status == 421
    assert client.get(path, origin="http://evil.example").status == 403
    assert client.ask("POST", path, cookie=None, origin="null")[0].status == 403
    assert client.get("/report", cookie=None, origin="null").status == 403


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium: install the package chromium")
def test_the_report_shows_a_camera_within_the_page(session, files, served, browser):
    context = browser.new_context(viewport={"width": 1400, "height": 900})
    context.set_default_timeout(120_000)
    page = context.new_page()
    write_document(session.out, CalibrationDocument(verdict="accepted", scene_file=str(session.scene_file), cameras=()))
    page.goto(served(session.out))
    page.locator("#report-box").scroll_into_view_if_needed()
    report = page.frame_locator("iframe[title='Report of the calibration']")
    report.locator("#camera-name").fill("cam-012")
    report.locator("#camera-name").press("Enter")
    report.locator("article[aria-label='Camera cam-012']").wait_for()
    report.get_by_role("button", name="Next camera").click()
    report.locator("article[aria-label='Camera cam-013']").wait_for()
    context.close()
