"""Everybody's way over the ground, from a calibrated rig and boxes with identities."""
