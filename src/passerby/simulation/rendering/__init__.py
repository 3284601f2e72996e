"""Pictures of simulated scenes: what each camera would film, with the true boxes known."""

from passerby.simulation.rendering.camera import RenderOptions, render_camera, write_videos

__all__ = ["RenderOptions", "render_camera", "write_videos"]
