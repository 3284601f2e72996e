"""The page that a person looks at, and the drawings of notebooks.

Takes finished values and files and decides nothing. Modules compute values; the markup is in `templates/` (Jinja2), which
`rendering` fills in. Imports `interchange`, `perception`, `people`, `solver` and below.
"""
