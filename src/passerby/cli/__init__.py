"""The command line: parse, call, print. The only room that prints.

May import everything; nothing imports it.
"""
