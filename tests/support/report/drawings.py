"""Simulated scenes as the report has them."""

from dataclasses import replace
from functools import cache

import numpy as np

from passerby.core.cameras import Rig
from passerby.core.observations import CameraObservations, Observations
from passerby.report.contents import Contents
from passerby.simulation import SimulationOptions, simulate
from support.report.pages import document_of


@cache
def simulated(preset="terrace", seconds=12.0, **more):
    """A scene without noise, seen by the true cameras."""
    return simulate(SimulationOptions(preset=preset, seconds=seconds, fps=5.0, seed=1, occlusion=False, **more))


def contents(made, *, rig=None, seen=None, told=None, clocks=None, videos=None):
    """The report's contents with the true cameras and heights, unless others are given."""
    heights = {str(identity): height for identity, height in made.heights.items()}
    usual = {"figures": {"people": {"identities": len(heights), "heights_m": heights}, "cameras": []}}
    document = document_of({"verdict": "accepted", "cameras": [], **(told or usual)})
    return Contents(document, rig or made.rig, seen or made.observations, clocks or {}, videos or {})


def with_lens(rig, name, change):
    """The rig with another lens in one camera."""
    return Rig(tuple(replace(one, lens=change(one.lens)) if one.name == name else one for one in rig))


def longer(factor):
    """A lens with another focal length."""

    def change(lens):
        matrix = np.array(lens.matrix)
        matrix[[0, 1], [0, 1]] *= factor
        return replace(lens, matrix=matrix)

    return change


def only_boxes(made):
    """The observations without joints."""
    return Observations({name: CameraObservations(seen.boxes) for name, seen in made.observations.cameras.items()})


def only_joints(made):
    """The observations without boxes."""
    seen = made.observations.cameras
    return Observations({name: CameraObservations(keypoints=one.keypoints) for name, one in seen.items()})
