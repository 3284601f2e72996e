"""From a folder of videos to a scene file that a person can go on with."""
