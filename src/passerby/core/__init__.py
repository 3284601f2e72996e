"""The basic data types of the package: cameras and rigs, observations, clocks, trajectories, scale cues, figures, solutions.

Includes the operations on them that all higher packages need (projection, synchronisation, overlap). Reads no files; imports
`geometry`, `findings` and lower packages.
"""
