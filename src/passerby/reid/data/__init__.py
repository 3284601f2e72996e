"""Sets of pictures of people: published ones, folders, and crops cut out of videos by tracks."""

from __future__ import annotations
