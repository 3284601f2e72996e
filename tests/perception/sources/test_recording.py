"""Recordings in pieces, and pictures: every picture of these films carries its number in its pixels."""

import os
import shutil
import struct
from datetime import UTC, datetime
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from passerby.common.errors import InputError
from passerby.findings.finding import Finding
from passerby.findings.texts import text_of
from passerby.interchange.video_writer import VideoWriter
from passerby.perception.kept import VideoFilesState, video_identity
from passerby.perception.sources import recording as recordings
from passerby.perception.sources.files import VideoSource, WallSpan
from passerby.perception.sources.recording import open_source, rebased, wall_extent
from passerby.perception.video import VideoReader, expected_count
from passerby.perception.video_still import still
from support.scenes.numbered_videos import SIZE, number_in, numbered

FPS = 10
BEGIN = datetime(2026, 11, 22, 8, 0, 0, tzinfo=UTC).timestamp()


def film(path: Path, first: int, count: int, fps: float = FPS, size: tuple[int, int] = SIZE) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with VideoWriter(path, size, fps, crf=20, key_every=fps) as video:
        for number in range(first, first + count):
            video.write(numbered(number, size))
    return path


def frigate(folder: Path, second: float) -> Path:
    time = datetime.fromtimestamp(BEGIN + int(second), UTC)
    return folder / f"{time:%Y-%m-%d}" / f"{time:%H}" / "north" / f"{time:%M.%S}.mp4"


def read(info, **options) -> list[tuple[int, int]]:  # type: ignore[no-untyped-def]
    """Number of each picture, and what it shows."""
    return [(frame.number, number_in(frame.picture)) for frame in VideoReader(info, **options)]


def same(first: int, last: int, later: int = 0) -> list[tuple[int, int]]:
    return [(number + later, number) for number in range(first, last + 1)]


def codes(findings: tuple[Finding, ...]) -> list[str]:
    for finding in findings:
        assert text_of(finding)
    return [finding.code for finding in findings]


def north(folder: Path) -> VideoSource:
    return VideoSource((folder / "*" / "*" / "north" / "*.mp4",))


def renamed(layout: Path, folder: Path, names: list[str]) -> Path:
    for name, path in zip(names, sorted(layout.rglob("*.mp4")), strict=True):
        shutil.copy(path, folder / f"{name}.mp4")
    return folder


def copied(folder: Path, tmp_path: Path) -> Path:
    return shutil.copytree(folder, tmp_path, dirs_exist_ok=True)


@pytest.fixture(scope="module")
def layout(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five pieces of two seconds, from 0.4 s after a whole second on."""
    folder = tmp_path_factory.mktemp("frigate") / "recordings"
    for piece in range(5):
        film(frigate(folder, 0.4 + 2 * piece), 1 + 20 * piece, 20)
    return folder


@pytest.fixture(scope="module")
def untimed(layout: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same pieces, called part9 to part13."""
    return renamed(layout, tmp_path_factory.mktemp("untimed"), [f"part{number}" for number in range(9, 14)])


def test_one_file_stays_one_file(untimed: Path) -> None:
    piece = untimed / "part9.mp4"
    found = open_source(VideoSource((piece,)))
    assert (found.info.pieces, found.info.files, found.findings, read(found.info)) == ((), (piece,), (), same(1, 20))


@pytest.mark.parametrize("named", [("",), ("part*.mp4",), ("part%d.mp4",), tuple(f"part{n}.mp4" for n in (13, 9, 10, 11, 12))])
def test_pieces_without_times_follow_at_once(untimed: Path, named: tuple[str, ...]) -> None:
    """All their frames are those of the whole film, whatever rate is asked for."""
    found = open_source(VideoSource(tuple(untimed / name for name in named)), "north")
    assert codes(found.findings) == ["pieces_untimed"]
    info = found.info
    assert (info.size, info.clock_fps, info.variable, info.frames, info.seconds) == (SIZE, FPS, False, 100, 10.0)
    assert (read(info), read(info, after=47)) == (same(1, 100), same(48, 100))
    assert read(info, rate=2.0) == [(number, number) for number in range(1, 101, 5)]
    assert (expected_count(info, 2.0), expected_count(info)) == (20, 100)


def test_names_state_where_pieces_lie(layout: Path, tmp_path: Path) -> None:
    found = open_source(north(layout), "north")
    assert (found.findings, read(found.info)) == ((), same(1, 100))
    assert found.info.wall.utc
    assert abs(found.info.wall.seconds - (BEGIN + 0.4)) <= 0.5
    assert wall_extent(north(layout)).begins == tuple(BEGIN + 2 * piece for piece in range(5))
    # A common origin moves all numbers.
    info = rebased(found.info, BEGIN - 60)
    assert read(info) == same(1, 100, 10 * 60 + round(10 * (found.info.wall.seconds - BEGIN)))
    assert info.wall.text == "2026-11-22T07:59:00+00:00"
    # By a pattern of the user's own.
    renamed(layout, tmp_path, [f"x0800{2 * piece:02}-22.11.26" for piece in range(5)])
    assert read(open_source(VideoSource((tmp_path,), names="x%H%M%S-%d.%m.%y.mp4")).info) == same(1, 100)
    with pytest.raises(InputError, match="is not built as video_names"):
        open_source(VideoSource((tmp_path,), names="x%H%M%S-%d.%m.%Y.mp4"))


def test_missing_broken_and_cut_pieces_leave_gaps(layout: Path, tmp_path: Path) -> None:
    pieces = sorted(copied(layout, tmp_path).rglob("*.mp4"))
    pieces[1].unlink()
    pieces[3].write_bytes(b"")
    found = open_source(north(tmp_path), "north")
    assert codes(found.findings) == ["pieces_unreadable", "recording_gaps"]
    unreadable, gaps = (finding.values for finding in found.findings)
    assert (unreadable["count"], unreadable["files"], gaps["count"], gaps["seconds"]) == (1, 4, 2, 4.0)
    assert (read(found.info), found.info.seconds) == (same(1, 20) + same(41, 60) + same(81, 100), 10.0)


def test_a_piece_that_breaks_while_it_is_read_is_counted(untimed: Path, tmp_path: Path) -> None:
    info = open_source(VideoSource((copied(untimed, tmp_path),))).info
    content = bytearray((tmp_path / "part10.mp4").read_bytes())
    begin = content.index(b"mdat") + 4
    content[begin : begin + len(content) // 2] = bytes(len(content) // 2)
    (tmp_path / "part10.mp4").write_bytes(content)
    (tmp_path / "part12.mp4").write_bytes(b"")
    reader = VideoReader(info)
    shown = {frame.number for frame in reader}
    assert {*range(1, 21), *range(41, 61), *range(81, 101)} <= shown
    assert reader.decoded.failed_pieces >= 1
    assert reader.decoded.failed_pieces + reader.decoded.broken >= 2


def test_overlapping_pieces_show_each_picture_once_and_those_of_another_size_or_rate_are_left_out(layout, tmp_path) -> None:
    for piece in range(4):
        film(frigate(tmp_path / "a", 3 * piece), 1 + 30 * piece, 40 if piece < 3 else 30)
    found = open_source(north(tmp_path / "a"), "north")
    assert "pieces_overlap" in codes(found.findings)
    assert read(found.info) == same(1, 120)
    copied(layout, tmp_path / "b")
    film(frigate(tmp_path / "b", 2), 21, 20, size=(48, 32))
    film(frigate(tmp_path / "b", 6), 61, 40, fps=20)
    found = open_source(north(tmp_path / "b"), "north")
    assert (codes(found.findings), found.findings[0].values["count"]) == (["pieces_differ", "recording_gaps"], 2)
    assert read(found.info) == same(1, 20) + same(41, 60) + same(81, 100)


def test_mixed_cameras_broken_videos_and_pictures_beside_videos_are_errors(layout: Path, tmp_path: Path) -> None:
    """Cameras of different sizes, or at the same times."""
    (tmp_path / "mixed").mkdir()
    renamed(layout, tmp_path / "mixed", [f"part{piece}" for piece in range(5)])
    for piece in range(3):
        film(tmp_path / "mixed" / f"side{piece}.mp4", 1, 5, size=(48, 32))
    with pytest.raises(InputError, match=r"5 of 96 x 64 .* and 3 of 48 x 32 .* several cameras"):
        open_source(VideoSource((tmp_path / "mixed",)))
    for path in copied(layout, tmp_path / "two").glob("*/*/north"):
        shutil.copytree(path, path.with_name("south"))
    with pytest.raises(InputError, match="several cameras"):
        open_source(VideoSource((tmp_path / "two",)))
    (tmp_path / "broken").mkdir()
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / "broken" / name).write_bytes(b"no video")
    with pytest.raises(InputError, match=r"none of its 2 videos can be read; the first, a\.mp4"):
        open_source(VideoSource((tmp_path / "broken",)))
    cv2.imwrite(str(tmp_path / "broken" / "a.png"), numbered(1))
    with pytest.raises(InputError, match=r"2 videos .* and 1 images"):
        open_source(VideoSource((tmp_path / "broken",)))
    with pytest.raises(InputError, match="no video and no image matches"):
        open_source(VideoSource((tmp_path / "c*.mp4",)))


def test_a_file_that_grows_is_an_error(untimed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    copied(untimed, tmp_path)
    probe = recordings.probe

    def growing(path: Path):  # type: ignore[no-untyped-def]
        with (tmp_path / "part13.mp4").open("ab") as file:
            file.write(bytes(100))
        return probe(path)

    monkeypatch.setattr(recordings, "probe", growing)
    with pytest.raises(InputError, match=r"part13\.mp4: is still being written"):
        open_source(VideoSource((tmp_path,)))


def test_a_span_opens_its_pieces_only_and_enters_a_long_one_by_a_key_frame(layout: Path, tmp_path: Path) -> None:
    """Pieces that cannot be read do not matter outside of the span."""
    source = VideoSource(north(copied(layout, tmp_path / "some")).paths, span=WallSpan(BEGIN + 3, BEGIN + 6))
    for path in sorted((tmp_path / "some").rglob("*.mp4"))[::4]:
        path.write_bytes(b"")
    found = open_source(source)
    assert (found.findings, found.info.seconds) == ((), pytest.approx(3.0))
    shown = [seen for _, seen in read(found.info)]
    assert shown == list(range(shown[0], shown[-1] + 1))
    assert 25 <= shown[0] <= 31
    assert 55 <= shown[-1] <= 61
    with pytest.raises(InputError, match=r"no file in the span .* from 2026-11-22T08:00:00\+00:00"):
        open_source(VideoSource(source.paths, span=WallSpan(BEGIN - 900, BEGIN - 800)))
    folder = tmp_path / "north"
    film(folder / "20261122_080000.mp4", 1, 250, fps=5)
    film(folder / "20261122_080050.mp4", 1, 5, fps=5)
    whole = open_source(VideoSource((folder,))).info
    span = WallSpan(whole.wall.seconds + 40.0, whole.wall.seconds + 44.0)
    reader = VideoReader(open_source(VideoSource((folder,), span=span)).info)
    assert [(frame.number, number_in(frame.picture)) for frame in reader] == same(201, 221)
    assert reader.decoded.pictures < 60
    reader = VideoReader(whole, after=230)
    rest = [*same(231, 250), *((250 + number, number) for number in range(1, 6))]
    assert [(frame.number, number_in(frame.picture)) for frame in reader] == rest
    assert reader.decoded.pictures < 60


def recorded(folder: Path, names: tuple[str, ...], created: tuple[int | None, ...]) -> tuple[list[float], set[str]]:
    """Where pieces that state when they were created begin, and the codes of what is odd about them."""
    folder.mkdir()
    for number, (name, offset) in enumerate(zip(names, created, strict=True)):
        with av.open(str(folder / name), "w") as container:
            if offset is not None:
                container.metadata["creation_time"] = f"{datetime.fromtimestamp(BEGIN + offset, UTC):%Y-%m-%dT%H:%M:%S}.000000Z"
            video = container.add_stream("mpeg4", rate=FPS)
            video.width, video.height, video.pix_fmt = 32, 32, "yuv420p"
            for level in range((4 if number < len(names) - 1 else 2) * FPS):
                container.mux(video.encode(av.VideoFrame.from_ndarray(np.full((32, 32, 3), level, np.uint8))))
            container.mux(video.encode())
    found = open_source(VideoSource((folder,)), "a")
    assert [piece.path.name for piece in found.info.pieces] == list(names)
    return [piece.begin_s for piece in found.info.pieces], {finding.code for finding in found.findings}


def test_chapters_of_a_makers_scheme_follow_at_once_and_one_that_is_missing_is_reported(tmp_path: Path) -> None:
    names = ("GX010012.MP4", "GX020012.MP4", "GX030012.MP4")
    assert recorded(tmp_path / "whole", names, (None,) * 3) == (pytest.approx([0.0, 4.0, 8.0]), set())
    assert recorded(tmp_path / "some", names[::2], (None, None))[1] == {"pieces_untimed"}


@pytest.mark.parametrize(
    ("created", "shown", "code"),
    [
        ((0, 4, 60), [0.0, 4.0, 60.0], "recording_gaps"),
        *((times, [0.0, 4.0, 8.0], "pieces_untimed") for times in ((0, 0, 0), (300, 303, 305), (20, 10, 0), (0, 4, None))),
    ],
    ids=["a gap", "start", "copies", "back", "one"],
)
def test_creation_times_show_gaps_but_those_that_cannot_be_of_pieces_are_not_used(tmp_path, created, shown, code):
    begins, codes = recorded(tmp_path / "a", ("walk_1.mp4", "walk_2.mp4", "walk_3.mp4"), created)
    assert (begins, codes) == (pytest.approx(shown, abs=0.6 if code == "recording_gaps" else 1e-6), {code})


def images(folder: Path, names: dict[str, int], size: tuple[int, int] = SIZE) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, number in names.items():
        cv2.imwrite(str(folder / name), numbered(number, size))
    return folder


def test_numbered_pictures_keep_their_numbers(tmp_path: Path) -> None:
    folder = images(tmp_path / "north", {f"frame_{n:06}.jpg": n for n in range(3, 60) if n not in range(20, 40)})
    found = open_source(VideoSource((folder,), fps=10.0), "north")
    assert (codes(found.findings), found.findings[0].values["seconds"]) == (["recording_gaps"], pytest.approx(2.0))
    assert read(found.info) == same(3, 19) + same(40, 59)
    assert (found.info.size, found.info.variable, found.info.clock_fps) == (SIZE, False, 10.0)
    assert read(found.info, rate=2.0) == [(n, n) for n in (3, 6, 11, 16, 40, 41, 46, 51, 56)]
    with pytest.raises(InputError, match=r"37 numbered images, and their rate is not known: set fps"):
        open_source(VideoSource((folder,)))
    # Those from zero count from one.
    folder = images(tmp_path / "south", {f"{n:08}.png": n for n in range(10)})
    assert read(open_source(VideoSource((folder,), fps=5.0)).info) == [(n + 1, n) for n in range(10)]


def test_a_table_states_times(tmp_path: Path) -> None:
    folder = images(tmp_path / "images", {f"{name}.jpg": n for n, name in enumerate("abcd", start=1)})
    table = tmp_path / "times.csv"

    def opened(rows: str, *names: str):  # type: ignore[no-untyped-def]
        table.write_text(rows)
        return open_source(VideoSource(tuple(folder / name for name in names or ("",)), times=table)).info

    info = opened("file,time\nimages/b.jpg,10.5\na.jpg,10.0\nc.jpg,11.25\nd.jpg,13\n")
    assert read(info) == [(1, 1), (51, 2), (126, 3), (301, 4)]
    assert info.wall is None
    with pytest.raises(InputError, match=r"has no time of c\.jpg \(2 of 4"):
        opened("a.jpg,2026-11-22T08:00:00.5\nb.jpg,2026-11-22T08:00:01\n")
    with pytest.raises(InputError, match="row 2"):
        opened("a.jpg,2026-11-22T08:00:00.5\nb.jpg,soon\n")
    wall = opened("a.jpg,2026-11-22T09:00:00+01:00\nb.jpg,2026-11-22T08:00:01Z\n", "a.jpg", "b.jpg").wall
    assert (wall.seconds, wall.utc) == (BEGIN, True)


def with_exif(path: Path, taken: str, below: str, orientation: int = 1) -> None:
    """Put Exif into a JPEG: little-endian TIFF with one inner directory."""
    jpeg = path.read_bytes()
    texts = taken.encode() + b"\0", below.encode().ljust(4, b"\0")[:4]
    inner_at, text_at = 8 + 2 + 2 * 12 + 4, 8 + 2 + 2 * 12 + 4 + 2 + 3 * 12 + 4
    main = struct.pack("<H", 2) + struct.pack("<HHIHH", 0x0112, 3, 1, orientation, 0)
    main += struct.pack("<HHII", 0x8769, 4, 1, inner_at) + bytes(4)
    inner = struct.pack("<H", 3) + struct.pack("<HHII", 0x9003, 2, len(texts[0]), text_at)
    inner += struct.pack("<HHI", 0x9291, 2, len(below) + 1) + texts[1] + struct.pack("<HHIHH", 0xA405, 3, 1, 28, 0) + bytes(4)
    tiff = b"II*\0" + struct.pack("<I", 8) + main + inner + texts[0]
    segment = b"Exif\0\0" + tiff
    path.write_bytes(jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:])


def test_exif_states_times_and_which_way_up_pictures_stand(tmp_path: Path) -> None:
    folder = images(tmp_path / "a", {"IMG_8812.jpg": 1, "IMG_8815.jpg": 2, "IMG_0001.jpg": 3})
    for name, second, below in (("IMG_8812.jpg", 0, "25"), ("IMG_8815.jpg", 0, "75"), ("IMG_0001.jpg", 2, "25")):
        with_exif(folder / name, f"2026:11:22 08:00:{second:02}", below)
    info = open_source(VideoSource((folder,))).info
    assert read(info) == [(1, 1), (51, 2), (201, 3)]
    assert (info.wall.seconds, info.wall.utc, info.camera.focal_35mm) == (BEGIN + 0.25, False, 28.0)
    folder = images(tmp_path / "b", {"1.jpg": 1, "2.jpg": 2})
    for name in ("1.jpg", "2.jpg"):
        with_exif(folder / name, "2026:11:22 08:00:00", "25", orientation=6)
    info = open_source(VideoSource((folder,), fps=1.0)).info
    assert (info.size, [frame.picture.shape[:2] for frame in VideoReader(info)]) == (SIZE[::-1], [SIZE, SIZE])


def test_broken_pictures_and_others_sizes_are_left_out(tmp_path: Path) -> None:
    folder = images(tmp_path, {f"{n:03}.png": n for n in range(1, 9)})
    (folder / "003.png").write_bytes(b"")
    images(folder, {"005.png": 5}, (48, 32))
    (folder / "007.png").write_bytes((folder / "007.png").read_bytes()[:60])
    found = open_source(VideoSource((folder,), fps=1.0), "north")
    assert codes(found.findings) == ["pieces_unreadable", "pieces_differ"]
    reader = VideoReader(found.info)
    assert ([frame.number for frame in reader], reader.decoded.failed_pieces) == ([1, 2, 4, 6, 8], 1)


def test_a_still_of_a_piece_and_of_pictures(layout: Path, tmp_path: Path) -> None:
    info = rebased(open_source(north(layout)).info, BEGIN - 60)
    first = read(info)[0][0]
    number = np.arange(first, first + 100)
    found = still(info, number, np.where(number == first + 66, 2.0, 1.0))
    assert (found.number, number_in(found.picture)) == (first + 66, 67)
    folder = images(tmp_path, {f"{n:03}.png": n for n in range(1, 9)})
    found = still(open_source(VideoSource((folder,), fps=1.0)).info, np.arange(1, 9), np.arange(8.0))
    assert (found.number, number_in(found.picture)) == (8, 8)


def test_kept_results_know_their_pieces_and_notice_one_that_changes(untimed: Path, tmp_path: Path) -> None:
    info, copy = (open_source(VideoSource((folder,))).info for folder in (untimed, copied(untimed, tmp_path)))
    assert video_identity(info) == video_identity(copy)
    state = VideoFilesState(copy)
    assert state.changed(3.0) is None
    os.utime(tmp_path / "part12.mp4", (1, 1))
    assert state.changed(5.0) is None
    assert state.changed(float("inf")) == tmp_path / "part12.mp4"
    (tmp_path / "part13.mp4").unlink()
    assert video_identity(open_source(VideoSource((tmp_path,))).info) != video_identity(info)
