"""What tests work on: scenes, data sets, networks and films made for them, and processes that die at a chosen moment."""
