"""One module for each command.

May import everything.
"""
