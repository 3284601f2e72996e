"""Only the opened page is answered, and only with files of the page and of a report."""

import re
import shutil

import pytest

from passerby.interchange.calibration_json import CalibrationDocument, write_document
from passerby.interchange.output_folder import report_folder
from passerby.page.session import Session
from passerby.report.page import write_report
from support.browser import CHROMIUM
from support.report.sites import site

from .conftest import HOST, PORT, TOKEN, Client, refusal


def test_the_token_becomes_a_cookie_that_scripts_and_other_sites_cannot_use(client):
    answer = client.get("/", f"token={TOKEN}", cookie=None)
    assert (answer.status, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"].lower()
    assert f"passerby-{PORT}={TOKEN}" in cookie
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    wrong = client.get("/", "token=wrong", cookie=None)
    assert (wrong.status, "set-cookie" in wrong.headers) == (403, False)
    page = client.get("/")
    assert page.status == 200
    assert TOKEN not in page.body.decode()


@pytest.mark.parametrize("path", ["/", "/api/state", "/picture", "/report", "/static/main.js"])
def test_nothing_is_shown_without_the_cookie(client, path):
    for cookie in (None, f"passerby-{PORT}=wrong", f"passerby-{PORT + 1}={TOKEN}", "passerby"):
        assert client.get(path, cookie=cookie).status == 403


def test_another_name_for_this_machine_and_other_methods_are_refused(client):
    """DNS rebinding: the browser asks this server by the attacker's name."""
    for host in ("evil.example", f"evil.example:{PORT}", "127.0.0.1", f"127.0.0.1:{PORT + 1}", None):
        assert client.get("/api/state", host=host).status == 421
    for method in ("PUT", "DELETE", "OPTIONS", "PATCH"):
        assert client.ask(method, "/api/state")[0].status == 405


@pytest.mark.parametrize("origin", ["http://evil.example", f"https://{HOST}", "null", None])
def test_another_site_cannot_act_nor_read(client, session, origin):
    before = session.scene_file.read_bytes()
    assert client.post("/api/act", {"act": "undo", "version": session.version}, origin=origin).status == 403
    assert session.scene_file.read_bytes() == before
    assert client.get("/api/state", origin=origin).status == (403 if origin else 200)
    assert "access-control-allow-origin" not in client.get("/api/state").headers


@pytest.mark.parametrize(("path", "block"), [("/api/act", 30_000), ("/api/plan/upload", 10_000_000)])
def test_a_body_is_read_up_to_the_limit_of_its_path(client, path, block):
    answer, taken = client.ask("POST", path, body=b"x", origin=f"http://{HOST}", content_length=str(10 * block))
    assert (answer.status, taken) == (413, [])
    for chunks, status in ((1000, 413), (2, 422)):
        answer, taken = client.ask("POST", path, chunks=[b"x" * block] * chunks, origin=f"http://{HOST}")
        assert (answer.status, len(taken)) == (status, min(chunks, 3))


def test_a_camera_is_a_name_of_the_scene_and_only_the_files_of_the_page_are_served(client):
    for camera in ("../../truth", "..%2f..%2ftruth", "/etc/passwd", "", "C9", "C1\x00"):
        assert "no such camera" in refusal(client.get("/picture", f"camera={camera}"))
    for path in ("/static/../session.py", "/static/%2e%2e/session.py", "/../pyproject.toml", "/static/"):
        assert client.get(path).status == 404


def test_the_policy_allows_only_what_is_served_here_and_the_report_runs_apart(client, session):
    headers = client.get("/").headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert not re.search("unsafe|http", policy)
    assert headers["x-content-type-options"] == "nosniff"
    (session.out / "report.html").write_text("<script>alert(1)</script>")
    policy = client.get("/report").headers["content-security-policy"]
    assert "sandbox allow-scripts" in policy
    assert "allow-same-origin" not in policy


def test_messages_name_no_folder_of_this_machine_and_a_name_with_html_is_data(client, session):
    session.scene_file.write_text("[cameras.C1]\nvideo = 'nowhere.mp4'\n", encoding="utf-8")
    told = client.get("/api/state").body + client.get("/api/check").body + client.get("/picture", "camera=C1").body
    assert b"scene.toml" in told
    assert str(session.out.parent).encode() not in told
    scene = session.out / "scene.toml"
    scene.write_text('[cameras."<img src=x onerror=alert(1)>"]\nvideo = "a.mp4"\n[cameras.B]\nvideo = "b.mp4"\n')
    client = Client(Session(scene, session.out))
    answer = client.get("/api/state")
    assert answer.headers["content-type"] == "application/json"
    assert answer.json()["cameras"] == []
    assert b"<img" not in client.get("/").body


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A report of many cameras, with files beside it."""
    page = tmp_path_factory.mktemp("site") / "report.html"
    write_report(site(56, seconds=4), page)
    return page


@pytest.fixture
def files(session, written):
    """Address of the folder of a report's files; some of the user's lie there too."""
    shutil.copy(written, session.out / "report.html")
    shutil.copytree(report_folder(written), report_folder(session.out / "report.html"))
    (stamped,) = report_folder(session.out / "report.html").iterdir()
    (stamped / "secret.txt").write_text("mine")
    (stamped.parent / "secret.js").write_text("mine")
    return f"/report_files/{stamped.name}"


def test_a_reports_files_are_served_without_the_token_that_the_report_does_not_have_and_no_others(client, files):
    path = f"{files}/camera-3.js"
    answer = client.get(path, cookie=None, origin="null")
    assert answer.status == 200
    assert answer.body.startswith(b'passerbyPart("camera-3",')
    assert answer.headers["content-type"].startswith("text/javascript")
    assert answer.headers["cross-origin-resource-policy"] == "cross-origin"
    assert answer.headers["x-content-type-options"] == "nosniff"
    for place in (
        f"{files}/secret.txt", "/report_files/secret.js", f"{files}/../secret.js", f"{files}/%2e%2e/secret.js", f"{files}/",
        "/report_files/../report.html", "/report_files/..%2fcamera-3.js", "/report_files/0123456789abcdef/camera-3.js",
        f"{files}/camera-99.js",
    ):  # fmt: skip
        assert client.get(place, cookie=None).status == 404, place
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
