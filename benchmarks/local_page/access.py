"""What can be said of a page's accessibility without axe-core: rules of the Web Content Accessibility Guidelines, by hand."""

from pathlib import Path

FAULTS = Path(__file__).with_suffix(".js").read_text(encoding="utf-8").partition("\n")[2]
"""A JavaScript function that gives the faults that it finds: language, landmarks, names of controls, texts of pictures, order
of headings, contrast of texts (4.5, large ones 3), and a visible focus."""
