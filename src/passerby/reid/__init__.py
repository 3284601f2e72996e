"""Re-identification networks of one's own: trained, adapted to a scene, evaluated, exported. Needs the extra `passerby[reid]`.

Only the modules that import torch need it, and nothing outside of this room imports one of them but inside a command.
"""
