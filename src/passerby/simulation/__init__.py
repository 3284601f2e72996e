"""Scenes with known truth, as boxes, joints or rendered videos.

Imports `interchange`, `perception` and below.
"""

from passerby.simulation.options import PRESETS, SimulationOptions
from passerby.simulation.scene import SimulatedScene, simulate
from passerby.simulation.write import write_scene

__all__ = ["PRESETS", "SimulatedScene", "SimulationOptions", "simulate", "write_scene"]
