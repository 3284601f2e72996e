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


def get(server, target, **more):
    fetch(server.url, target, SHA256, len(BODY), **more)


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


def test_arrives_whole_and_tells_how_far_it_is(server, target):
    told = []
    get(server, target, tell=lambda stage, done=0, total=0: told.append((stage, done, total)))
    assert target.read_bytes() == BODY
    assert not part_of(target).exists()
    assert told[0] == ("fetching tiny.onnx (kB)", 0, 300)
    assert told[-1] == ("fetching tiny.onnx (kB)", 300, 300)
    done = [item[1] for item in told]
    assert done == sorted(done)
    assert len(set(done)) > 2


def test_what_is_there_is_not_fetched(server, target):
    target.parent.mkdir()
    target.write_bytes(b"mine")
    get(server, target)
    assert target.read_bytes() == b"mine"
    assert server.asked == []


def test_a_break_is_mended_at_once(server, target):
    server.breaks_after = [100_000, 50_000]
    get(server, target)
    assert target.read_bytes() == BODY
    assert server.asked == [None, "bytes=100000-", "bytes=150000-"]


def test_gives_up_where_nothing_comes_and_goes_on_later(server, target):
    server.breaks_after = [120_000, 0, 0, 0]
    with pytest.raises(UnreachableError, match=r"127\.0\.0\.1.* after 120000 of 300000 bytes"):
        get(server, target)
    assert not target.exists()
    assert part_of(target).read_bytes() == BODY[:120_000]
    server.asked.clear()
    get(server, target)
    assert server.asked == ["bytes=120000-"]
    assert target.read_bytes() == BODY


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
    assert server.asked == [f"bytes={kept}-"]
    assert target.read_bytes() == BODY


def test_a_server_without_parts_sends_all_again(server, target):
    server.ranges = False
    server.breaks_after = [100_000]
    get(server, target)
    assert server.asked == [None, "bytes=100000-"]
    assert target.read_bytes() == BODY


def test_another_part_than_asked_for_is_not_used(server, target):
    server.breaks_after = [100_000]
    server.content_range = f"bytes 0-{len(BODY) - 1}/{len(BODY)}"
    get(server, target)
    assert server.asked == [None, "bytes=100000-", None]
    assert target.read_bytes() == BODY


def test_rubbish_of_a_crash_is_begun_anew(server, target):
    target.parent.mkdir()
    part_of(target).write_bytes(bytes(200_000))
    get(server, target)
    assert server.asked == ["bytes=200000-", None]
    assert target.read_bytes() == BODY


@pytest.mark.parametrize("rubbish", [len(BODY), len(BODY) + 1])
def test_rubbish_as_long_as_the_file_is_not_taken_for_it(server, target, rubbish):
    target.parent.mkdir()
    part_of(target).write_bytes(bytes(rubbish))
    get(server, target)
    assert server.asked == [None]
    assert target.read_bytes() == BODY


def test_a_wrong_checksum_leaves_nothing(server, target):
    server.body = BODY[:-1] + bytes([BODY[-1] ^ 1])
    with pytest.raises(InputError, match=f"{server.url}: sends another file: SHA-256 .* instead of {SHA256}.*PASSERBY_MODELS"):
        get(server, target)
    assert visible(target) == []
    assert not part_of(target).exists()


@pytest.mark.parametrize("body", [b"<html>please log in</html>", BODY + b"x"])
def test_a_file_of_another_size_is_refused(server, target, body):
    server.body = body
    with pytest.raises(InputError, match=rf"another file \({len(body)} bytes instead of 300000\)"):
        get(server, target)
    assert visible(target) == []


def test_a_refusal_is_a_reason(server, target):
    server.status = 404
    with pytest.raises(UnreachableError, match=r"tiny\.onnx: the server says 404"):
        get(server, target)
    assert visible(target) == []


def test_no_server(server, target):
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
        with pytest.raises(UnreachableError, match=rf"127\.0\.0\.1:{port}: no connection"):
            fetch(f"http://127.0.0.1:{port}/tiny.onnx", target, SHA256, len(BODY))


def test_a_server_that_never_answers(server, target, monkeypatch):
    monkeypatch.setattr(fetching, "ANSWER_S", 0.1)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        port = mute.getsockname()[1]
        with pytest.raises(UnreachableError, match=rf"127\.0\.0\.1:{port}: no answer within 0.1 s"):
            fetch(f"http://127.0.0.1:{port}/tiny.onnx", target, SHA256, len(BODY))


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


def test_no_downloads_where_the_user_forbids_them(server, target, monkeypatch):
    monkeypatch.setenv("PASSERBY_OFFLINE", "1")
    with pytest.raises(UnreachableError, match="PASSERBY_OFFLINE is set"):
        get(server, target)
    assert server.asked == []
    monkeypatch.setenv("PASSERBY_OFFLINE", "0")
    get(server, target)
    assert target.exists()


def test_redirections_are_followed(server, target):
    server.location = "/moved"
    get(server, target)
    assert target.read_bytes() == BODY


def test_a_proxy_is_asked_in_place_of_the_server(server, target, monkeypatch):
    monkeypatch.setenv("no_proxy", "")
    monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{server.port}")
    fetch("http://localhost:1/tiny.onnx", target, SHA256, len(BODY))
    assert target.read_bytes() == BODY
    assert server.asked == [None]


def test_nothing_is_fetched_over_an_open_line(server, target):
    with pytest.raises(InputError, match=r"http://example\.invalid/a: is not an https address"):
        fetch("http://example.invalid/a", target, SHA256, len(BODY))
    server.location = "http://example.invalid/a"
    with pytest.raises(InputError, match=r"http://example\.invalid/a: is not an https address"):
        get(server, target)


def test_a_folder_that_cannot_be_written(server, tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(UnreachableError, match=r"file.*: cannot be written"):
        get(server, tmp_path / "file" / "tiny.onnx")


def test_two_processes_fetch_it_once(server, target):
    server.hold = threading.Event()
    processes = [other_process(server, target) for _ in range(2)]
    until(lambda: server.asked, *processes)
    told = []

    def tell(stage, done=0, total=0):
        told.append(stage)
        server.hold.set()

    get(server, target, tell=tell)
    assert [process.wait() for process in processes] == [0, 0]
    assert target.read_bytes() == BODY
    assert server.asked == [None]
    assert told[0] == "waiting for another process that is fetching tiny.onnx"
