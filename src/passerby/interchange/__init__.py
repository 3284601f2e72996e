"""File formats, one module each: read, checked in full, and written atomically."""
