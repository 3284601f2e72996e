"""The report of many cameras: a page, and files beside it that it loads when they are asked for."""

import errno
import json
import os
import re
from itertools import combinations
from unittest.mock import Mock

import numpy as np
import pytest

from passerby.calibration.writing import write_calibration
from passerby.common.errors import InputError
from passerby.core.overlap import Shared
from passerby.findings.finding import doubt
from passerby.interchange.output_folder import report_files, report_folder
from passerby.report import page as page_module
from passerby.report import parts as parts_module
from passerby.report.distances import TAPE_M, distances_of, distances_to_measure
from passerby.report.page import write_report
from passerby.report.parts import Parts, parts_beside
from passerby.report.seen import find_seen, neighbours_of, zones_of
from passerby.report.view_graph import links_of, weakest_links
from support.report.pages import Page, with_figures
from support.report.sites import site

MANY, FEW = 60, 50
"""Cameras: of a report with files, and of one without."""
LOST = "cam-007"


@pytest.fixture(scope="session")
def contents():
    few = doubt("few_observations", "cam-010", agreeing=3)
    groups = [{"group": 2, "folder": "groups/2", "verdict": "accepted", "registered": 2, "cameras": ["gate-1", "gate-2"]}]
    return site(MANY, problems=[few], lost=[LOST], groups=groups)


@pytest.fixture(scope="session")
def other():
    return site(MANY, seconds=6, seed=1)


@pytest.fixture(scope="session")
def written(contents, tmp_path_factory):
    path = tmp_path_factory.mktemp("site") / "report.html"
    write_report(contents, path)
    return path


@pytest.fixture
def page(written):
    return Page(written.read_text(encoding="utf-8"))


@pytest.fixture
def path(contents, tmp_path):
    """A report of its own."""
    write_report(contents, tmp_path / "report.html")
    return tmp_path / "report.html"


def parts_of(path):
    """The folder of files that a page names."""
    return path.parent / re.search('data-parts="([^"]+)"', path.read_text(encoding="utf-8"))[1]


def value_of(path):
    """What a file hands over to the page."""
    told = re.fullmatch(r"passerbyPart\(\"([a-z0-9-]+)\",(.*)\);\n", path.read_text(encoding="utf-8"), re.DOTALL)
    assert told[1] == path.stem
    return json.loads(told[2])


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.slow
def test_fifty_cameras_are_one_file_and_more_have_files_beside_the_page_that_grows_little(contents, tmp_path, written):
    few = tmp_path / "few" / "report.html"
    few.parent.mkdir()
    write_report(site(FEW, seconds=4), few)
    assert names_in(few.parent) == ["report.html"]
    assert "plotly" in few.read_text(encoding="utf-8")
    assert names_in(written.parent) == ["report.html", "report_files"]
    assert names_in(report_folder(written)) == [parts_of(written).name]
    (tmp_path / "other").mkdir()
    elsewhere = tmp_path / "other" / "elsewhere.html"
    write_report(contents, elsewhere)
    assert names_in(elsewhere.parent) == ["elsewhere.html", "elsewhere_files"]
    assert parts_of(elsewhere).parent.name == "elsewhere_files"
    write_report(site(2 * MANY), tmp_path / "report.html")
    # A thousand cameras stay far below 20 MB.
    assert (tmp_path / "report.html").stat().st_size - written.stat().st_size < 4000 * MANY


def test_there_is_a_file_for_each_plot_and_each_camera_with_its_panel(written, page, contents):
    plots = {told["data-part"] for _, told in page.elements if "data-part" in told}
    assert plots >= {"rig-above", "rig-space", "timeline-plot", "heights-plot"}
    cameras = {f"camera-{place}" for place in range(MANY)}
    assert {path.stem for path in parts_of(written).iterdir()} == cameras | plots | {"plotly"}
    links = {told["href"] for tag, told in page.elements if tag == "a" and told.get("href", "").startswith("#camera=")}
    assert links == {f"#camera={place}" for place in range(MANY)}
    for place, said in ((0, ""), (6, "not registered"), (9, "only 3 supporting observations"), (33, "")):
        html = value_of(parts_of(written) / f"camera-{place}.js")["html"]
        panels = re.findall(r'<article class="view" aria-label="Camera ([^"]+)"', html)
        assert panels == [contents.rig.names[place]]
        assert "camera-picture" in html
        assert said in html


@pytest.mark.slow
def test_the_same_contents_give_the_same_bytes_and_mend_what_is_damaged(contents, written, path):
    def check_same():
        assert path.read_bytes() == written.read_bytes()
        assert parts_of(path).name == parts_of(written).name
        for part in parts_of(written).iterdir():
            assert (parts_of(path) / part.name).read_bytes() == part.read_bytes()

    check_same()
    damaged = parts_of(path) / "camera-3.js"
    damaged.write_bytes(damaged.read_bytes()[:100])
    (parts_of(path) / "camera-4.js").unlink()
    write_report(contents, path)
    check_same()


@pytest.mark.slow
def test_a_new_report_takes_the_place_of_the_old_one_and_of_its_files(other, path):
    first = parts_of(path)
    (report_folder(path) / "notes.txt").write_text("mine")
    write_report(other, path)
    assert parts_of(path) != first
    assert not first.exists()
    write_report(site(4, seconds=4), path)
    assert report_files(path) == [path]
    assert names_in(report_folder(path)) == ["notes.txt"]


@pytest.mark.slow
@pytest.mark.parametrize("when", ["files", "page"])
def test_a_disk_that_is_full_leaves_the_old_report_whole(contents, other, path, monkeypatch, when):
    before = {one: one.read_bytes() for one in report_files(path)}
    full = OSError(errno.ENOSPC, "No space left on device")

    def fail(*_):
        raise full if when == "files" else InputError(f"{path}: cannot be written")

    monkeypatch.setattr(*((Parts, "place") if when == "files" else (page_module, "write_text")), fail)
    with pytest.raises(InputError, match="cannot be written"):
        write_report(other, path)
    assert {one: one.read_bytes() for one in before} == before
    monkeypatch.undo()
    assert not list(path.parent.glob(".*"))
    write_report(contents, path)
    assert set(report_files(path)) == set(before)


def test_a_new_calibration_takes_an_earlier_reports_files_along(calibrated, contents, tmp_path):
    path = tmp_path / "report.html"
    write_calibration(calibrated[0], tmp_path, report=False)
    write_report(contents, path)
    (report_folder(path) / "notes.txt").write_text("mine")
    write_calibration(calibrated[0], tmp_path, report=False)
    assert report_files(path) == []
    assert names_in(report_folder(path)) == ["notes.txt"]
    write_report(contents, path)
    (report_folder(path) / "notes.txt").unlink()
    write_calibration(calibrated[0], tmp_path)
    assert path.is_file()
    assert not report_folder(path).exists()


def test_the_list_begins_with_what_is_wrong_and_ends_with_other_groups(page):
    rows = page.rows("cameras-table")
    assert len(rows) == MANY + 2
    assert [(row["Camera"], row["State"]) for row in (*rows[:3], *rows[-2:])] == [
        (LOST, "no pose"), ("cam-010", "problem"), ("cam-001", "good"), ("gate-1", "other group"), ("gate-2", "other group"),
    ]  # fmt: skip
    assert rows[0]["What is wrong"] == "Could not be connected to other cameras."
    assert rows[1]["What is wrong"] == "Camera cam-010 has only 3 supporting observations."
    links = [told["href"] for tag, told in page.elements if tag == "a" and told.get("href", "").startswith("groups/")]
    assert links.count("groups/2/report.html") == 3  # in the summary, and of both cameras


def test_zones_are_neighbours_that_can_be_read_or_the_groups_that_the_scene_states():
    contents = site(100, seconds=4, lost=[LOST])
    zones = zones_of(contents)
    assert LOST not in zones
    assert len(zones) == 99
    sizes = np.bincount(list(zones.values()))[1:]
    assert sizes.min() > 4
    assert sizes.max() <= 16
    centre = {camera.name: camera.centre[:2] for camera in contents.rig.posed()}
    for zone in range(1, len(sizes) + 1):
        spread = np.ptp([centre[name] for name in zones if zones[name] == zone], axis=0).max()
        assert spread < 0.6 * np.ptp(list(centre.values()), axis=0).max()
    names = [f"cam-{number:03d}" for number in range(1, MANY + 1)]
    zones = zones_of(site(MANY, seconds=4, stated=[names[:20], names[10:40], names[40:]]))
    assert [zones[name] for name in (names[0], names[15], names[30], names[50])] == [1, 1, 2, 3]


def test_shared_sightings_are_the_same_without_looking_at_all_pairs_and_neighbours_share_most(contents):
    seen = find_seen(contents)
    looks = {name: contents.observations[name].boxes for name in contents.rig.names}
    sightings = {name: set(zip(one.frame.tolist(), one.identity.tolist(), strict=True)) for name, one in looks.items()}
    for first, second in combinations(contents.rig.names, 2):
        both = sightings[first] & sightings[second]
        expected = Shared(len({who for _, who in both}), len(both))
        assert seen.shared.get((first, second), Shared(0, 0)) == expected
    assert len(seen.shared) < MANY * (MANY - 1) / 8

    near = neighbours_of(contents.rig, seen)
    assert not any(LOST in names for names in near.values())
    assert set(near["cam-001"]) >= {"cam-002", "cam-003", "cam-004"}  # of the same hall
    for name, names in near.items():
        shared = [max(seen.shared.get(pair, Shared(0, 0)).sightings for pair in ((name, one), (one, name))) for one in names]
        assert shared == sorted(shared, reverse=True)
        assert len(names) <= 16
        assert 0 not in shared


def test_a_pair_that_a_stage_tells_of_is_a_link_although_it_shares_nobody_and_the_weakest_come_first(contents):
    names, seen = contents.rig.names, find_seen(contents)
    pair = {"cameras": [names[-1], names[0]], "route": "ground", "inliers": 5, "matches": 10, "support": 1.0}
    links = {(one.first, one.second): one for one in links_of(with_figures(contents, pairs=[pair]), seen)}
    told = links[names[0], names[-1]]
    assert (told.shared, told.word) == (Shared(0, 0), "fair")
    assert list(links) == sorted(links, key=lambda pair: [names.index(name) for name in pair])
    links = weakest_links(links_of(contents, seen))
    assert len(links) > 20
    assert all(link.used for link in links)
    assert [link.confidence for link in links] == sorted(link.confidence for link in links)


def test_the_distances_that_are_listed_are_the_best_to_measure(contents):
    found, every = distances_to_measure(contents), distances_of(contents)
    within = sorted((one.metres for one in every if one.metres <= TAPE_M), reverse=True)
    assert 20 < len(found) < 200
    assert [one.metres for one in found] == pytest.approx(within[: len(found)])
    all_of_them = distances_to_measure(contents, len(every))
    beyond = [one.metres for one in all_of_them[len(within) :]]
    assert len(all_of_them) == len(every)
    assert beyond == pytest.approx(sorted(one.metres for one in every if one.metres > TAPE_M))


def write(page, **values):
    """Files beside a page."""
    with parts_beside(page) as parts:
        for name, value in values.items():
            parts.add(name, value)
        parts.add_script("plot", "drawn();")
        return parts.place()


def files(folder):
    return {str(path.relative_to(folder)): path.read_text() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_files_lie_in_a_folder_that_is_named_after_their_content_and_damaged_ones_are_mended(tmp_path):
    place = write(tmp_path / "new" / "report.html", c1={"x": [1.0, float("nan")], "text": "</script>é"})
    assert place.startswith("report_files/")
    whole = files(tmp_path / "new")
    assert whole == {
        f"{place}/c1.js": 'passerbyPart("c1",{"x":[1.0,null],"text":"</script>\\u00e9"});\n',
        f"{place}/plot.js": 'drawn();\npasserbyPart("plot",null);\n',
    }
    other = write(tmp_path / "new" / "report.html", c1=2)
    assert other != place
    assert {str(name).rpartition("/")[0] for name in files(tmp_path / "new")} == {place, other}
    whole = files(tmp_path / "new")
    (tmp_path / "new" / other / "c1.js").write_text("damaged")
    (tmp_path / "new" / other / "plot.js").unlink()
    assert write(tmp_path / "new" / "report.html", c1=2) == other
    assert files(tmp_path / "new") == whole
    assert names_in(tmp_path / "new") == ["report_files"]


def test_a_place_that_cannot_be_written_to_is_named_and_a_full_disk_leaves_the_files_before(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match=r"file/report\.html: cannot be written"):
        write(tmp_path / "file" / "report.html", c1=1)
    (tmp_path / "report_files").write_text("mine")
    with pytest.raises(InputError, match="report_files: cannot be written"):
        write(tmp_path / "report.html", c1=1)
    assert files(tmp_path) == {"file": "mine", "report_files": "mine"}
    (tmp_path / "report_files").unlink()
    write(tmp_path / "report.html", c1=1)
    before = files(tmp_path)
    monkeypatch.setattr(parts_module.os, "fsync", Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))))
    with pytest.raises(InputError, match=r"report_files: cannot be written \(No space left on device\): make room there"):
        write(tmp_path / "report.html", c1=2)
    assert files(tmp_path) == before
    assert names_in(tmp_path) == ["file", "report_files"]
