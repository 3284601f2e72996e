"""Pictures of simulated scenes: what each camera would film, with the true boxes known."""

from passerby.simulation.rendering.camera import render_camera
from passerby.simulation.rendering.options import RenderOptions
from passerby.simulation.rendering.videos import write_videos

__all__ = ["RenderOptions", "render_camera", "write_videos"]
