"""The local page in a real browser: clicks, times, kills."""
