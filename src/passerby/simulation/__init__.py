"""Scenes with known truth, as boxes, joints or rendered videos.

This package imports `interchange`, `perception` and lower packages.
"""

from passerby.simulation.options import PRESETS, SimulationOptions
from passerby.simulation.scene import SimulatedScene, simulate
from passerby.simulation.write import write_scene

__all__ = ["PRESETS", "SimulatedScene", "SimulationOptions", "simulate", "write_scene"]
