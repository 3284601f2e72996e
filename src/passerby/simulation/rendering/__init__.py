"""Rendered pictures of simulated scenes for each camera; the true boxes are known."""

from passerby.simulation.rendering.camera import RenderOptions, render_camera, write_videos

__all__ = ["RenderOptions", "render_camera", "write_videos"]
