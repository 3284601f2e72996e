"""Nobody but the opened page is answered."""

import json
import re

import pytest

from passerby.page.app import LIMITS
from passerby.page.security import MOST_BYTES
from passerby.page.session import Session

from .conftest import HOST, PORT, TOKEN, Client


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


@pytest.mark.parametrize("host", ["evil.example", f"evil.example:{PORT}", "127.0.0.1", f"127.0.0.1:{PORT + 1}", None])
def test_another_name_for_this_machine_is_refused(client, host):
    """DNS rebinding: the browser asks this server by the attacker's name."""
    assert client.get("/api/state", host=host).status == 421


@pytest.mark.parametrize("origin", ["http://evil.example", f"https://{HOST}", "null", None])
def test_another_site_cannot_act_nor_read(client, session, origin):
    before = session.scene_file.read_bytes()
    assert (
        client.post("/api/act", json.dumps({"act": "undo", "version": session.version}).encode(), origin=origin).status == 403
    )
    assert session.scene_file.read_bytes() == before
    assert client.get("/api/state", origin=origin).status == (403 if origin else 200)
    assert "access-control-allow-origin" not in client.get("/api/state").headers


@pytest.mark.parametrize(("path", "most"), [("/api/act", MOST_BYTES), ("/api/plan/upload", LIMITS["/api/plan/upload"])])
def test_a_body_is_read_up_to_the_limit_of_its_path(client, path, most):
    answer, taken = client.ask("POST", path, body=b"x", origin=f"http://{HOST}", content_length=str(most + 1))
    assert (answer.status, taken) == (413, [])
    for chunks, status in ((1000, 413), (2, 422)):
        answer, taken = client.ask("POST", path, chunks=[b"x" * (most // 2)] * chunks, origin=f"http://{HOST}")
        assert (answer.status, len(taken)) == (status, min(chunks, 3))


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH"])
def test_other_methods_are_refused(client, method):
    assert client.ask(method, "/api/state")[0].status == 405


@pytest.mark.parametrize("camera", ["../../truth", "..%2f..%2ftruth", "/etc/passwd", "", "C9", "C1\x00"])
def test_a_camera_is_a_name_of_the_scene_and_never_a_path(client, camera):
    answer = client.get("/picture", f"camera={camera}")
    assert answer.status == 422
    assert "no such camera" in answer.json()["error"]


@pytest.mark.parametrize("path", ["/static/../session.py", "/static/%2e%2e/session.py", "/../pyproject.toml", "/static/"])
def test_only_the_files_of_the_page_are_served(client, path):
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


def test_messages_name_no_folder_of_this_machine(client, session):
    session.scene_file.write_text("[cameras.C1]\nvideo = 'nowhere.mp4'\n", encoding="utf-8")
    told = client.get("/api/state").body + client.get("/api/check").body + client.get("/picture", "camera=C1").body
    assert b"scene.toml" in told
    assert str(session.out.parent).encode() not in told


def test_a_name_with_html_is_data(simulated, tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text('[cameras."<img src=x onerror=alert(1)>"]\nvideo = "a.mp4"\n[cameras.B]\nvideo = "b.mp4"\n')
    client = Client(Session(scene, tmp_path / "out"))
    answer = client.get("/api/state")
    assert answer.headers["content-type"] == "application/json"
    assert answer.json()["cameras"] == []
    assert b"<img" not in client.get("/").body
