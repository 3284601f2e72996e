"""Processes that are killed, or run out of disk, at a chosen moment."""
