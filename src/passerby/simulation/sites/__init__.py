"""Sites of many cameras with known truth: floors of corridors and halls, people with destinations, boxes only.

The modules are `plan` (zones, doors, stairs, places of cameras, and the ground that each camera sees), `walkers` (positions of
people over time) and `site` (the whole site, camera by camera, and its folder). Time and memory grow linearly with the number
of cameras.
"""

from passerby.simulation.sites.site import Site, simulate_site, write_site
from passerby.simulation.sites.walkers import SITES, SiteOptions

__all__ = ["SITES", "Site", "SiteOptions", "simulate_site", "write_site"]
