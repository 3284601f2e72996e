"""The nouns that every room speaks in: cameras and rigs, observations, clocks, trajectories, scale cues, figures, solutions.

Values, and what all rooms above need of them (projection, synchronisation, overlap). Reads no files; imports `geometry`,
`findings` and below.
"""
