"""Reading the page as a program, and contents that are made up."""

import json
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np

from passerby.core.cameras import PoseSigma, Rig
from passerby.core.observations import Boxes, CameraObservations, Clock, Observations
from passerby.findings.texts import diagnostic, text_of
from passerby.interchange.calibration_json import parse_document
from passerby.interchange.storage.text_formats import plain
from passerby.report.contents import Contents
from support.scenes.people_and_rigs import ring

PEOPLE_IN_VIEW = 4
HOSTILE = (
    "<script>alert(1)</script>", "</script><img src=x onerror=alert(2)>", "\"'><b onmouseover=alert(3)>", "Küche %{x} Ⅲ 🎥",
)  # fmt: skip
"""Names of cameras."""


class Page(HTMLParser):
    """Tables by id (rows of exact values), sections by id (their text), scripts, and all attributes of all elements."""

    def __init__(self, html):
        super().__init__()
        self.tables, self.heads, self.sections, self.scripts, self.elements = {}, {}, {}, [], []
        self.title, self.text = "", ""
        self._table = self._section = self._script = None
        self._in_title = False
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        told = dict(attributes)
        self.elements.append((tag, told))
        if tag == "section":
            self._section = told["id"]
            self.sections[self._section] = ""
        elif tag == "table":
            self._table = told["id"]
            self.tables[self._table], self.heads[self._table] = [], []
        elif tag == "tr" and self._table:
            self.tables[self._table].append([])
        elif tag in ("td", "th") and self._table:
            if "data-csv" in told:
                self.heads[self._table].append(told["data-csv"])
            else:
                self.tables[self._table][-1].append(told.get("data-value"))
        elif tag == "script":
            self._script = told
            self.scripts.append((told, ""))
        elif tag == "title" and not self.title:
            self._in_title = True

    def handle_endtag(self, tag):
        if tag == "section":
            self._section = None
        elif tag == "table":
            self.tables[self._table] = [row for row in self.tables[self._table] if row]
            self._table = None
        elif tag == "script":
            self._script = None
        elif tag == "title":
            self._in_title = False

    def handle_data(self, data):
        if self._script is not None:
            self.scripts[-1] = (self._script, self.scripts[-1][1] + data)
            return
        if self._in_title:
            self.title += data
        self.text += data
        if self._section:
            self.sections[self._section] += data

    def rows(self, table):
        """The rows of a table as dictionaries by the heads."""
        return [dict(zip(self.heads[table], row, strict=True)) for row in self.tables[table]]


def solved(scene, name, dropped, change=str):
    """Calibrate a variant of a scene, without the lines that set a key and changed: (calibration, output folder)."""
    import passerby

    path, out = scene / f"{name}.toml", scene.parent / name
    lines = (scene / "scene.toml").read_text().splitlines(keepends=True)
    path.write_text(change("".join(line for line in lines if not line.startswith(f"{dropped} ="))))
    calibration = passerby.calibrate(path)
    calibration.write(out)
    return calibration, out


def named(contents, names):
    """The same contents with other names of the cameras."""
    new = dict(zip(contents.rig.names, names, strict=True))
    rig = replace(contents.rig, cameras=tuple(replace(camera, name=new[camera.name]) for camera in contents.rig))
    document = document_of(renamed(plain(contents.document), new))
    seen = {new[name]: one for name, one in contents.observations.cameras.items()}
    clocks = {new[name]: clock for name, clock in contents.clocks.items()}
    observations = Observations(seen, contents.observations.fps, clocks)
    return Contents(document, rig, observations, clocks, {new[name]: path for name, path in contents.videos.items()})


def renamed(value, new):
    """Everything that is called like a camera, called otherwise."""
    if isinstance(value, dict):
        return {new.get(key, key): renamed(one, new) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [renamed(one, new) for one in value]
    return new.get(value, value) if isinstance(value, str) else value


def diagnosed(*findings):
    """What `calibration.json` holds of findings."""
    texts = {"reasons": [], "findings": []}
    for one in findings:
        texts["findings" if one.severity == "notice" else "reasons"].append(text_of(one))
    return {**texts, "diagnostics": [diagnostic(one) for one in findings]}


def without_poses(contents, *findings):
    """The same contents as a refused calibration would have them."""
    rig = Rig(tuple(replace(camera, pose=None, sigma=None) for camera in contents.rig), "refused")
    gone = (
        "centre_m", "height_m", "heading_deg", "tilt_deg", "roll_deg", "rotation", "translation_m", "position_sigma_mm",
        "orientation_sigma_deg", "median_residual_px",
    )  # fmt: skip
    cameras = [{**plain(one), **dict.fromkeys(gone), "registered": False} for one in contents.document.cameras]
    told = changed(contents, verdict="refused", **diagnosed(*findings), cameras=cameras, figures={})
    return replace(told, rig=rig)


def document_of(tables):
    """`calibration.json` as it is read from these tables."""
    return parse_document(json.dumps(tables))


def changed(contents, **tables):
    """The same contents with other tables in `calibration.json`."""
    return replace(contents, document=document_of({**plain(contents.document), **tables}))


def with_figures(contents, **tables):
    """The same contents with other tables in `figures`."""
    return changed(contents, figures={**plain(contents.document.figures), **tables})


def busy_place(cameras, people, seconds, fps, seed=0):
    """Contents of a long recording of a busy place: people come and go before every camera. Boxes are not exact."""
    rng = np.random.default_rng(seed)
    covariance = np.diag([0.01, 0.01, 0.01, 1e-5, 1e-5, 1e-5])
    rig = Rig(tuple(replace(one, sigma=PoseSigma(0.17, 0.3, covariance)) for one in ring(cameras)), "accepted")
    seen = {}
    for camera in rig:
        frames, identities = [], []
        for identity in range(1, people + 1):
            inside = _stays(rng, round(seconds * fps), PEOPLE_IN_VIEW / people, fps)
            frames.append(inside)
            identities.append(np.full(len(inside), identity))
        frame, identity = np.concatenate(frames) + 1, np.concatenate(identities)
        height = rng.uniform(60, 160, len(frame))
        left, top = rng.uniform(0, 500, (2, len(frame)))
        boxes = Boxes(frame, identity, np.column_stack([left, top, height / 3, height]), np.ones(len(frame)))
        seen[camera.name] = CameraObservations(boxes)
    clocks = {name: Clock(fps) for name in rig.names}
    return Contents(document_of(_told(rig, seen, people, fps)), rig, Observations(seen, fps, clocks), clocks, {})


def _stays(rng, frames, share, fps):
    """Instants at which somebody is in view: stays of 20 seconds in the mean, missed now and then."""
    inside = []
    for begin in np.flatnonzero(rng.uniform(size=frames) < share / (20 * fps)):
        stay = np.arange(begin, min(frames, begin + 1 + int(rng.exponential(20 * fps))))
        inside.append(stay[rng.uniform(size=len(stay)) < 0.9])
    return np.unique(np.concatenate(inside)) if inside else np.zeros(0, dtype=int)


def _told(rig, seen, people, fps):
    """What `calibration.json` would hold of a busy place."""
    pairs = [(a, b, 300) for place, a in enumerate(rig.names) for b in rig.names[place + 1 :]]
    cue = {
        "cue": f"population of {people}", "kind": "population", "count": people, "stated_m": 1.72, "measured_m": 1.7,
        "sd_m": 0.05, "residual_sigmas": -0.4, "share": 1.0,
    }  # fmt: skip
    heights = {who: 1.5 + 0.4 * who / people for who in range(1, people + 1)}
    return calibration_tables("busy", rig, seen, fps, pairs, heights, [cue])


def calibration_tables(name, rig, seen, fps, pairs, heights, cues=()):
    """What `calibration.json` would hold; pairs are of two names and the number of inliers."""
    cameras, posed = [], [camera.name for camera in rig if camera.pose is not None]
    for camera in rig:
        boxes = seen[camera.name].boxes
        told = {"name": camera.name, "registered": camera.pose is not None, "boxes": len(boxes), "keypoints": 0}
        told |= {"people": len(set(boxes.identity.tolist())), "fps": fps, "time_offset_s": 0.0, "time_offset_sigma_s": 0.01}
        if camera.pose is not None:
            told |= {"centre_m": camera.centre.tolist(), "height_m": float(camera.centre[2]), "median_residual_px": 2.0}
            told |= {"position_sigma_mm": 170.0, "orientation_sigma_deg": 0.3}
        cameras.append(told)
    figures = {
        "cameras": [{"name": one, "shape_position_sigma_mm": 30.0, "median_residual_px": 2.0} for one in posed],
        "pairs": [{"cameras": [a, b], "route": "ground", "inliers": n, "matches": 400, "support": 0.9} for a, b, n in pairs],
        "people": {"identities": len(heights), "heights_m": {str(who): height for who, height in heights.items()}},
        "scale": {"relative_sigma": 0.03, "cues": list(cues)}, "vertical_sigma_deg": 0.2,
    }  # fmt: skip
    scale = {"person_height_m": 1.72, "person_height_sd_m": 0.09}
    return {
        "name": name, "verdict": "accepted", **diagnosed(), "cameras": cameras, "method": "people", "seed": 0,
        "figures": figures, "association": {"mode": "given"}, "scene": {"scale": scale},
    }  # fmt: skip
