"""The command line: parse arguments, call functions, print results. It is the only package that prints.

It may import all packages; no other package imports it.
"""
