"""Sites of many cameras with known truth: floors of corridors and halls, people with destinations, boxes only.

`plan` (zones, doors, stairs, where cameras hang), `sight` (which ground each camera sees), `walkers` (who is where and when),
`site` (all of it together, camera by camera) and `write`. Time and memory grow linearly with the number of cameras.
"""

from passerby.simulation.sites.site import Site, simulate_site, write_site
from passerby.simulation.sites.walkers import SITES, SiteOptions

__all__ = ["SITES", "Site", "SiteOptions", "simulate_site", "write_site"]
