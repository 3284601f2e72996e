"""Fetching a file over bad lines: it arrives whole and right, or not at all."""

import socket
import subprocess
import sys
import threading
import time

import pytest

from passerby.common.errors import InputError
from passerby.perception import fetching
from passerby.perception.fetching import UnreachableError, fetch
from support.networks.model_server import BODY, SHA256, keep_to, serving

FETCH = """
import sys
from pathlib import Path
from passerby.perception import fetching
url, target, sha256, size = sys.argv[1:]
fetching.ANSWER_S = fetching.STALL_S = 600
fetching.fetch(url, Path(target), sha256, int(size))
"""


@pytest.fixture
def server(tmp_path, monkeypatch):
    keep_to(tmp_path, monkeypatch)
    with serving(monkeypatch) as server:
        yield server


@pytest.fixture
def target(tmp_path):
    return tmp_path / "deep" / "tiny.onnx"


def get(server, target, url=None, **more):
    fetch(url or server.url, target, SHA256, len(BODY), **more)


def other_process(server, target):
    return subprocess.Popen([sys.executable, "-c", FETCH, server.url, str(target), SHA256, str(len(BODY))])


def until(happens, *processes):
    """Wait for what the processes bring about, however slow the machine is; they must not end before."""
    while not happens():
        assert all(process.poll() is None for process in processes)
        time.sleep(0.02)


def part_of(target):
    return target.with_name(f".tiny.onnx.{SHA256[:12]}.part")


def visible(target):
    return [path.name for path in target.parent.iterdir() if not path.name.startswith(".")]


def test_arrives_whole_and_reports_progress(server, target):
    heard = []
    get(server, target, tell=lambda stage, done=0, total=0: heard.append((stage, done, total)))
    assert target.read_bytes() == BODY
    assert not part_of(target).exists()
    assert (heard[0], heard[-1]) == (("fetching tiny.onnx (kB)", 0, 300), ("fetching tiny.onnx (kB)", 300, 300))
    done = [item[1] for item in heard]
    assert done == sorted(done)
    assert len(set(done)) > 2


@pytest.mark.parametrize(
    ("server_is", "rubbish", "asked"),
    [
        ({"breaks_after": [100_000, 50_000]}, 0, [None, "bytes=100000-", "bytes=150000-"]),
        ({"breaks_after": [100_000], "ranges": False}, 0, [None, "bytes=100000-"]),
        ({"breaks_after": [100_000], "content_range": "bytes 0-299999/300000"}, 0, [None, "bytes=100000-", None]),
        ({"location": "/moved"}, 0, [None, None]),
        ({}, 200_000, ["bytes=200000-", None]),
        ({}, len(BODY), [None]),
        ({}, len(BODY) + 1, [None]),
    ],
    ids=["mended at once", "without parts", "another part", "redirected", "rubbish", "rubbish as long", "longer"],
)
def test_breaks_are_mended_and_what_a_crash_left_is_not_taken_for_the_file(server, target, server_is, rubbish, asked):
    if rubbish:
        target.parent.mkdir()
        part_of(target).write_bytes(bytes(rubbish))
    for name, value in server_is.items():
        setattr(server, name, list(value) if name == "breaks_after" else value)
    get(server, target)
    assert (target.read_bytes(), server.asked) == (BODY, asked)


def test_gives_up_where_nothing_comes_and_goes_on_later(server, target):
    server.breaks_after = [120_000, 0, 0, 0]
    with pytest.raises(UnreachableError, match=r"127\.0\.0\.1.* after 120000 of 300000 bytes"):
        get(server, target)
    assert not target.exists()
    assert part_of(target).read_bytes() == BODY[:120_000]
    server.asked.clear()
    get(server, target)
    assert (server.asked, target.read_bytes()) == (["bytes=120000-"], BODY)


def test_a_killed_process_is_gone_on_with(server, target):
    server.hold = threading.Event()
    process = other_process(server, target)
    until(lambda: part_of(target).exists() and part_of(target).stat().st_size > 50_000, process)
    process.kill()
    process.wait()
    assert visible(target) == []
    kept = part_of(target).stat().st_size
    assert 50_000 < kept <= len(BODY) // 2
    server.hold.set()
    server.asked.clear()
    get(server, target)
    assert (server.asked, target.read_bytes()) == ([f"bytes={kept}-"], BODY)


@pytest.mark.parametrize(
    ("body", "said"),
    [
        (BODY[:-1] + bytes([BODY[-1] ^ 1]), f"SHA-256 .* instead of {SHA256}.*PASSERBY_MODELS"),
        (b"<html>please log in</html>", r"\(26 bytes instead of 300000\)"),
        (BODY + b"x", r"\(300001 bytes instead of 300000\)"),
    ],
    ids=["checksum", "page", "longer"],
)
def test_another_file_is_refused_and_leaves_nothing(server, target, body, said):
    server.body = body
    with pytest.raises(InputError, match=rf"{server.url}: sends another file:? ?{said}"):
        get(server, target)
    assert visible(target) == []
    assert not part_of(target).exists()


def test_a_refusal_no_server_a_mute_one_and_a_folder_that_cannot_be_written_are_reasons(server, target, monkeypatch):
    server.status = 404
    with pytest.raises(UnreachableError, match=r"tiny\.onnx: the server says 404"):
        get(server, target)
    monkeypatch.setattr(fetching, "ANSWER_S", 0.1)
    with socket.socket() as closed, socket.create_server(("127.0.0.1", 0)) as mute:
        closed.bind(("127.0.0.1", 0))
        for one, said in ((closed, "no connection"), (mute, "no answer within 0.1 s")):
            port = one.getsockname()[1]
            with pytest.raises(UnreachableError, match=rf"127\.0\.0\.1:{port}: {said}"):
                get(server, target, f"http://127.0.0.1:{port}/tiny.onnx")
    assert not target.parent.exists() or visible(target) == []
    target.parents[1].joinpath("file").write_text("no folder")
    with pytest.raises(UnreachableError, match=r"file.*: cannot be written"):
        get(server, target.parents[1] / "file" / "tiny.onnx")


@pytest.mark.slow
def test_a_transfer_that_stalls(server, target, monkeypatch):
    """Half of the file comes, however long that takes; then the server holds back half of whatever it is asked for."""
    server.breaks_after = [150_000]

    def tell(stage, done=0, total=0):
        if done == 150:
            server.hold = threading.Event()
            monkeypatch.setattr(fetching, "STALL_S", 0.1)

    with pytest.raises(UnreachableError, match=r"timed out after \d+ of 300000 bytes"):
        get(server, target, tell=tell)
    assert part_of(target).stat().st_size >= 150_000
    assert not target.exists()


def test_nothing_is_fetched_where_the_user_forbids_it_the_line_is_open_or_the_file_is_there(server, target, monkeypatch):
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    with pytest.raises(UnreachableError, match="PASSERBY_OFFLINE is set"):
        get(server, target)
    assert server.asked == []
    monkeypatch.setenv("PASSERBY_OFFLINE", "0")
    server.location = "http://example.invalid/a"
    for url in (server.location, server.url):
        with pytest.raises(InputError, match=r"http://example\.invalid/a: is not an https address"):
            get(server, target, url)
    server.location = None
    server.asked.clear()
    get(server, target)
    target.write_bytes(b"mine")
    get(server, target)
    assert (target.read_bytes(), server.asked) == (b"mine", [None])


def test_a_proxy_is_asked_in_place_of_the_server(server, target, monkeypatch):
    monkeypatch.setenv("no_proxy", "")
    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{server.port}")
    get(server, target, "http://localhost:1/tiny.onnx")
    assert (target.read_bytes(), server.asked) == (BODY, [None])


def test_two_processes_fetch_it_once(server, target):
    server.hold = threading.Event()
    processes = [other_process(server, target) for _ in range(2)]
    until(lambda: server.asked, *processes)
    heard = []

    def tell(stage, done=0, total=0):
        heard.append(stage)
        server.hold.set()

    get(server, target, tell=tell)
    assert ([process.wait() for process in processes], target.read_bytes(), server.asked) == ([0, 0], BODY, [None])
    assert heard[0] == "waiting for another process that is fetching tiny.onnx"
