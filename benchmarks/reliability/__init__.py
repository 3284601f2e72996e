"""How honest Passerby is: its sigmas, its verdict, the monitor, damaged files and failing machines."""
