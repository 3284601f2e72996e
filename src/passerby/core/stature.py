"""How tall people are; without numpy, since the command line names it."""

PERSON_HEIGHT_M, PERSON_HEIGHT_SD_M = 1.72, 0.09
"""Standing height of people, shoes on, and how much they differ (one sigma)."""
