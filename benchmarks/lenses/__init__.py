"""What becomes of a rig where nobody states the intrinsics: the same scenes, with the true lenses and with estimated ones."""
