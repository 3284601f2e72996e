"""The browser that pages are tested in: the Chromium that the machine has, one for all tests of a process."""

import shutil

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
START_S = 240
"""A busy machine starts it slowly; this only bounds a test that fails."""
# Without a graphics card, WebGL is drawn by the processor.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
