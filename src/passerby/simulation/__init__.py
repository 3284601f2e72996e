"""Simulated scenes: cameras around an area, people who walk, jump and crouch in it, and what the cameras see of them."""

from passerby.simulation.options import SimulationOptions
from passerby.simulation.presets import PRESETS
from passerby.simulation.scene import SimulatedScene, simulate
from passerby.simulation.write import write_scene

__all__ = ["PRESETS", "SimulatedScene", "SimulationOptions", "simulate", "write_scene"]
