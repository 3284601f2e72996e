"""The report: one HTML page that tells whether a calibration is good, where it is weak and what to do."""
