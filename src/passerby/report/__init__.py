"""The report of a calibration as a page of HTML, and the drawings in notebooks.

The package takes finished values and files, and makes no decisions. Its modules compute values. The markup is in `templates/`
(Jinja2), which `rendering` fills in. It imports `interchange`, `perception`, `people`, `solver` and the layers below.
"""
