"""How files are handled, whatever is in them: safe parsing, faults by file, whole writes, locks, transactions, archives.

Imports `common` only.
"""
