"""Simulated scenes calibrated with one thing known of their scale, or with nothing."""
