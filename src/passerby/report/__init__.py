"""The page that a person looks at, and the drawings of notebooks.

Takes finished values and files and decides nothing. Imports `interchange`, `perception`, `people`, `solver` and below.
"""
