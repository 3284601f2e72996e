"""Handling of files, independent of their content: safe parsing, faults by file, atomic writes, locks, transactions, archives.

Imports `common` only.
"""
