"""Passerby beside today's peers on the same observations: caliscope, COLMAP, GLOMAP and humancalib's bundle adjustment.

Every engine runs in a process of its own, each peer in an environment that holds nothing but the peer. What the peers are
given is one neutral file of points (`protocol.py`), made from the very boxes and joints that Passerby's scene file names.
"""
