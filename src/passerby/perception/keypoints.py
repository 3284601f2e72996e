"""Joints of people by networks that look at one person's crop at a time."""

from __future__ import annotations

from passerby.common.errors import InputError
from passerby.perception.keypoints_heatmaps import HeatmapKeypoints
from passerby.perception.keypoints_movenet import MovenetKeypoints
from passerby.perception.keypoints_simcc import SimccKeypoints
from passerby.perception.networks import Network
from passerby.perception.pictures import KeypointEstimator

__all__ = ["HeatmapKeypoints", "MovenetKeypoints", "SimccKeypoints", "open_keypoints"]

_KINDS = {kind.kind: kind for kind in (MovenetKeypoints, SimccKeypoints, HeatmapKeypoints)}


def open_keypoints(network: Network) -> KeypointEstimator:
    """The estimator for a network's kind of output.

    Raises `InputError` for a file that does not open, is not of the kind that it is said to be, or finds no joints.
    """
    kind = _KINDS.get(network.output)
    if kind is None:
        raise InputError(f"{network.path}: its output is {network.output}: keypoints need one of {', '.join(_KINDS)}")
    return kind(network)
