"""General tools: errors, progress, processes, text of messages, names of array types.

This package imports no other package of Passerby, and every package may import it.
"""
