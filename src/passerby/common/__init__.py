"""What any program needs: errors, progress, processes, text of messages, names of array types.

Nothing of Passerby is imported here, and every room may import it.
"""
