"""The upright person: segments in pictures, viewing rays, bodies on the ground, and a camera's pose from known people.

The mathematics of people for association, solver, diagnostics, monitoring and report. Imports `core` and below.
"""
