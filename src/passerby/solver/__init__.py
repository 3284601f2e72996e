"""From identified people to a rig: the faithful GeoPose solver and the person-model solver."""
