"""How good a rig is: measured against the truth."""
