"""`passerby align` on rig files and output folders, and `[world]` of the scene file."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from passerby.calibration.calibrate import calibrate
from passerby.cli.main import run
from passerby.common.errors import InputError
from passerby.interchange.rig_toml import read_rig, write_rig
from passerby.interchange.world_files import read_known_points, read_known_positions
from passerby.simulation import SimulationOptions, simulate, write_scene


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """(scene folder, output folder): a terrace with identities given."""
    root = tmp_path_factory.mktemp("align")
    write_scene(simulate(SimulationOptions(seconds=12.0, box_noise=0.02, seed=4)), root / "scene")
    assert run(["calibrate", str(root / "scene" / "scene.toml"), "-o", str(root / "out")]) == 0
    return root / "scene", root / "out"


@pytest.fixture
def out(made, tmp_path):
    return shutil.copytree(made[1], tmp_path / "out")


def truth(made):
    return read_rig(made[0] / "truth.toml")


def positions_csv(rig, path, header="camera,x,y,z"):
    path.write_text(header + "\n" + "".join(f"{c.name},{','.join(map(repr, c.centre.tolist()))}\n" for c in rig))
    return path


def points_csv(rig, path, spots=((0.5, 3.0), (-2.0, 1.0), (2.0, 4.0), (3.0, 0.0), (0.0, -1.0))):
    rows = ["point,camera,u,v,x,y"]
    centre = np.mean([camera.centre[:2] for camera in rig], axis=0)
    for number, spot in enumerate(spots, start=1):
        x, y = centre + spot
        for camera in rig:
            u, v = camera.project(np.array([x, y, 0.0]))[0]
            if 0 <= u <= camera.lens.size[0] and 0 <= v <= camera.lens.size[1]:
                rows.append(f"p{number},{camera.name},{float(u)!r},{float(v)!r},{float(x)!r},{float(y)!r}")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_rig_by_a_camera(out, tmp_path, capsys):
    assert run(["align", str(out / "rig.toml"), "-o", str(tmp_path / "a.toml"), "--camera", "C3", "--towards", "C1"]) == 0
    said = capsys.readouterr()
    assert ("written to" in said.out, said.err) == (True, "")
    before, after = read_rig(out / "rig.toml"), read_rig(tmp_path / "a.toml")
    assert after["C3"].centre == pytest.approx((0, 0, before["C3"].centre[2]), abs=1e-9)
    assert after["C1"].centre[1] == pytest.approx(0, abs=1e-9)
    assert (after.verdict, after.metadata["world"]) == ("accepted", "camera C3 towards C1")
    assert after["C2"].sigma.position_m == pytest.approx(before["C2"].sigma.position_m)
    apart = (np.linalg.norm(rig["C2"].centre - rig["C4"].centre) for rig in (before, after))
    assert next(apart) == pytest.approx(next(apart))


def test_a_rig_by_points_of_the_true_world(made, out, tmp_path, capsys):
    true = truth(made)
    points = points_csv(true, tmp_path / "points.csv")
    assert run(["align", str(out), "-o", str(tmp_path / "a.toml"), "--points", str(points), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["left_out"] == 0
    assert len(told["residuals"]) == told["used"] > 5
    assert max(row["off_m"] for row in told["residuals"]) < 1.0
    aligned = read_rig(tmp_path / "a.toml")
    for camera in true:
        assert np.linalg.norm(aligned[camera.name].centre - camera.centre) < 3 * aligned[camera.name].sigma.position_m + 0.1
    assert run(["align", str(out), "-o", str(tmp_path / "b.toml"), "--points", str(points), "--scale", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    scaled = read_rig(tmp_path / "b.toml")
    for camera in true:
        assert np.linalg.norm(scaled[camera.name].centre - camera.centre) < 0.15
    assert run(["evaluate", str(tmp_path / "b.toml"), str(made[0] / "truth.toml"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scale_ratio"] == pytest.approx(1, abs=3 * told["scale_sigma"] + 0.005)


def test_the_table_names_a_wrong_point(out, tmp_path, capsys):
    rig = read_rig(out / "rig.toml")
    path = points_csv(rig, tmp_path / "points.csv")
    lines = path.read_text().splitlines()
    wrong = next(n for n, line in enumerate(lines) if line.startswith("p2,"))
    name, camera, _, v, x, y = lines[wrong].split(",")
    lines[wrong] = ",".join([name, camera, "20.0", v, x, y])
    path.write_text("\n".join(lines) + "\n")
    assert run(["align", str(out), "-o", str(tmp_path / "a.toml"), "--points", str(path)]) == 0
    said = capsys.readouterr()
    assert f"note: point p2 in camera {camera} has a residual of" in said.err
    row = next(cells for line in said.out.splitlines() if (cells := line.split())[:2] == ["p2", camera])
    assert row[-1] == "no"
    assert "uncertainty (1 sigma): heading" in said.out


@pytest.mark.slow
def test_a_whole_folder_into_a_new_one(made, out, tmp_path, capsys):
    (out / "trajectories").mkdir()
    positions = positions_csv(truth(made), tmp_path / "positions.csv")
    new = tmp_path / "new"
    assert run(["align", str(out), "-o", str(new), "--positions", str(positions), "--scale"]) == 0
    assert (
        f"{out / 'trajectories'} uses the old frame: write it in the new one with `passerby track {new}`"
        in capsys.readouterr().err
    )
    before, after = (json.loads((folder / "calibration.json").read_text()) for folder in (out, new))
    assert (new / "tracks" / "C1.txt").read_bytes() == (out / "tracks" / "C1.txt").read_bytes()
    assert (new / "report.html").is_file()
    rig, scale = read_rig(new / "rig.toml"), after["world"]["scale"]
    assert 0.85 < scale < 1.15
    assert scale != 1
    for table, old in zip(after["cameras"], before["cameras"], strict=True):
        camera = rig[table["name"]]
        assert table["centre_m"] == pytest.approx(camera.centre)
        assert table["translation_m"] == pytest.approx(camera.pose.t_cw)
        assert table["position_sigma_mm"] == pytest.approx(1000 * camera.sigma.position_m)
        # The scale is the survey's now, and its uncertainty by people's heights is gone.
        assert table["position_sigma_mm"] < 0.7 * scale * old["position_sigma_mm"]
        off_mm = 1000 * np.linalg.norm(camera.centre - truth(made)[camera.name].centre)
        assert off_mm < 3 * table["position_sigma_mm"]
        assert table["boxes"] == old["boxes"]
        assert list(table) == list(old)
    people = after["figures"]["people"]["heights_m"], before["figures"]["people"]["heights_m"]
    assert people[0] == pytest.approx({key: scale * value for key, value in people[1].items()})
    assert after["figures"]["scale"] == before["figures"]["scale"]
    assert after["world"]["by"] == "positions positions.csv"
    # The other commands take it, and people are where the true ones were.
    ground = ["--truth", str(made[0] / "ground_positions.csv"), "--true-rig", str(made[0] / "truth.toml")]
    assert run(["track", str(new), "--json", *ground]) == 0
    assert json.loads(capsys.readouterr().out)["truth"]["similarity"]["mean_m"] < 0.12


@pytest.mark.slow
def test_a_folder_is_aligned_in_place(out, capsys):
    before, page = (out / "tracks" / "C1.txt").read_bytes(), (out / "report.html").read_text()
    for source in (out / "rig.toml", out):
        assert run(["align", str(source), "-o", str(out), "--camera", "C2"]) == 0
        assert capsys.readouterr().err == ""
        told = json.loads((out / "calibration.json").read_text())
        assert told["cameras"][1]["centre_m"][:2] == pytest.approx((0, 0), abs=1e-9)
        assert told["world"]["by"] == "camera C2"
        assert read_rig(out / "rig.toml")["C4"].centre == pytest.approx(told["cameras"][3]["centre_m"])
        assert (out / "tracks" / "C1.txt").read_bytes() == before
        assert (out / "report.html").read_text() != page


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ([], "nothing given: give one of --camera, --points, --positions"),
        (["--camera", "C1", "--points", "x.csv"], "--camera and --points given"),
        (["--points", "x.csv", "--towards", "C1"], "--towards needs --camera"),
        (["--camera", "C1", "--towards", "C1"], "--towards names the camera of --camera itself"),
        (["--camera", "C1", "--tilt"], "need --points or --positions"),
        (["--camera", "C9"], "no camera C9: it has C1, C2, C3, C4"),
        (["--points", "missing.csv"], "missing.csv: no such file"),
        (["--points", "points.csv"], "points.csv: line 2: x is 'a'"),
        (["--positions", "positions.csv"], "no camera C9"),
    ],
)
def test_contradictions(out, tmp_path, monkeypatch, capsys, options, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "points.csv").write_text("camera,u,v,x,y\nC1,1,2,a,4\n")
    (tmp_path / "positions.csv").write_text("camera,x,y\nC9,1,2\nC1,1,3\n")
    assert run(["align", str(out), "-o", "a.toml", *options]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.parametrize(
    ("what", "target", "says"),
    [
        ("out/rig.toml", "out/rig.toml", "would stay in the old frame: give -o"),
        ("lone.toml", "new", "give a file that ends in .toml"),
        ("out", "full", "is not empty: give a new folder"),
        ("old", "new", ""),
    ],
)
def test_no_folder_is_left_in_two_frames(out, tmp_path, monkeypatch, capsys, what, target, says):
    monkeypatch.chdir(tmp_path)
    shutil.copy(out / "rig.toml", "lone.toml")
    shutil.copytree(out, "old", ignore=shutil.ignore_patterns("calibration.json"))
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine").touch()
    assert run(["align", what, "-o", target, "--camera", "C1"]) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_too_little_ends_with_three(out, tmp_path, capsys):
    rig = read_rig(out / "rig.toml")
    lone = points_csv(rig, tmp_path / "points.csv", spots=((0.5, 3.0),))
    assert run(["align", str(out), "-o", str(tmp_path / "a.toml"), "--points", str(lone)]) == 3
    assert "points.csv: 1 point cannot fix the heading: give 2 or more" in capsys.readouterr().err
    write_rig(tmp_path / "none.toml", replace(rig, cameras=tuple(replace(c, pose=None, sigma=None) for c in rig)))
    assert run(["align", str(tmp_path / "none.toml"), "-o", str(tmp_path / "a.toml"), "--camera", "C1"]) == 3
    assert "none of the 4 cameras has a pose" in capsys.readouterr().err


def test_points_and_positions_of_toml_are_those_of_csv(tmp_path):
    (tmp_path / "p.csv").write_text("camera,u,v,x,y,z,note\nC1,1,2,3,4,0.5,hm\nC2,5,6,3,4,0.5,\nC1,7,8,9,10,,\n")
    rows = ("C1", 1, 2, 3, 4, 0.5), ("C2", 5, 6, 3, 4, 0.5), ("C1", 7, 8, 9, 10)
    tables = ("".join(f"{key} = {value!r}\n" for key, value in zip("uvxyz", row[1:], strict=False)) for row in rows)
    text = "".join(f'[[points]]\ncamera = "{row[0]}"\n{table}' for row, table in zip(rows, tables, strict=True))
    (tmp_path / "p.toml").write_text(text)
    by_csv, by_toml = (
        [(p.name, p.xyz.tolist(), p.pixels, p.sd_m) for p in read_known_points(tmp_path / name)] for name in ("p.csv", "p.toml")
    )
    assert by_csv == by_toml
    assert [name for name, *_ in by_csv] == ["1", "2"]
    assert by_csv[0][2] == {"C1": (1, 2), "C2": (5, 6)}
    path = tmp_path / "q.toml"
    path.write_text('[[positions]]\ncamera = "C1"\nlat = 52.0\nlon = 13.0\n')
    (known,), geodetic = read_known_positions(path)
    assert (geodetic, bool(np.isnan(known.place[2])), known.sd_m) == (True, True, 3.0)
    path.write_text(path.read_text().replace("lat =", "latt ="))
    with pytest.raises(InputError, match=r"\[\[positions\]\] 1: unknown key 'latt': did you mean 'lat'"):
        read_known_positions(path)


def world_scene(made, tmp_path, world):
    folder = shutil.copytree(made[0], tmp_path / "scene", dirs_exist_ok=True)
    path = folder / "scene.toml"
    path.write_text((made[0] / "scene.toml").read_text() + world)
    return path


@pytest.mark.system
def test_the_scene_file_sets_the_frame_as_aligning_afterwards_does(made, tmp_path):
    by_camera = calibrate(world_scene(made, tmp_path, '\n[world]\ncamera = "C2"\n'))
    assert by_camera.rig["C2"].centre[:2] == pytest.approx((0, 0), abs=1e-9)
    assert by_camera.rig["C2"].pose.heading_deg == pytest.approx(0, abs=1e-9)
    assert by_camera.findings == ()
    assert by_camera.to_dict()["world"]["by"] == "camera C2"
    points = points_csv(truth(made), made[0] / "points.csv")
    worlds = '\n[world]\npoints = "points.csv"\nscale = true\n', ""
    placed, plain = (calibrate(world_scene(made, tmp_path, world)) for world in worlds)
    for camera in truth(made):
        assert np.linalg.norm(placed.rig[camera.name].centre - camera.centre) < 0.15
    assert "world" not in plain.to_dict()
    placed.write(tmp_path / "one")
    plain.write(tmp_path / "two")
    assert run(["align", str(tmp_path / "two"), "-o", str(tmp_path / "three"), "--points", str(points), "--scale"]) == 0
    for one, three in zip(read_rig(tmp_path / "one" / "rig.toml"), read_rig(tmp_path / "three" / "rig.toml"), strict=True):
        assert one.centre == pytest.approx(three.centre, abs=1e-6)
        assert one.pose.R_cw == pytest.approx(three.pose.R_cw, abs=1e-7)
        assert one.sigma.covariance == pytest.approx(three.sigma.covariance, rel=1e-5, abs=1e-12)
    one, three = (json.loads((tmp_path / name / "calibration.json").read_text()) for name in ("one", "three"))
    for key in ("by", "used", "left_out"):
        assert one["world"][key] == three["world"][key]
    assert one["figures"]["people"]["heights_m"] == pytest.approx(three["figures"]["people"]["heights_m"])
    # A frame that cannot be set is a finding, and the rig stays in its own.
    near = made[0] / "near.csv"
    near.write_text("camera,x,y,sd_m\nC1,0,0,5\nC2,0.1,0,5\n")
    kept = calibrate(world_scene(made, tmp_path, f"\n[world]\npositions = '{near}'\n"))
    assert kept.accepted
    (finding,) = kept.findings
    assert "[world]: the rig stays in its own frame: the positions fix " in finding
    assert kept.rig["C1"].centre[:2] == pytest.approx((0, 0), abs=1e-9)
    assert "world" not in kept.to_dict()


@pytest.mark.parametrize(
    ("world", "says"),
    [
        ("", "has none of them: give one of camera, points, positions"),
        ('camera = "C1"\npoints = "p.csv"', "has camera and points: give one"),
        ('points = "p.csv"\ntowards = "C1"', "towards needs camera"),
        ('camera = "C1"\ntowards = "C1"', "towards is the camera itself"),
        ('camera = "C1"\nscale = true', "scale and tilt need points or positions"),
        ('camera = "C7"', "[world] camera: camera 'C7' is not declared: did you mean 'C"),
        ('camera = "C1"\ntoward = "C2"', "[world]: unknown key 'toward': did you mean 'towards'?"),
        ('points = "p.csv"', "p.csv: no such file"),
        ('positions = "x.csv"', "x.csv: camera 'C8' is not declared in"),
        ('points = "y.csv"', "y.csv: point 1 in camera C1: (9000, 2) lies outside its"),
    ],
)
def test_a_world_that_cannot_be_is_an_error_before_anything_is_computed(made, tmp_path, capsys, world, says):
    path = world_scene(made, tmp_path, f"\n[world]\n{world}\n")
    (path.parent / "x.csv").write_text("camera,x,y\nC1,0,0\nC8,1,1\n")
    (path.parent / "y.csv").write_text("camera,u,v,x,y\nC1,9000,2,0,0\nC2,1,2,3,4\n")
    assert run(["check", str(path)]) == 2
    said = capsys.readouterr().err
    assert says in said
    assert str(path.parent) in said
    assert run(["calibrate", str(path), "-o", str(tmp_path / "never")]) == 2
    assert not (tmp_path / "never").exists()
