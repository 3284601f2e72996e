"""Cameras, people, pictures and videos whose truth is known."""
