"""A report that a browser opens as a file, and whatever it said or fetched."""

import time

LAPTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
PATIENCE_S = 120
"""A busy machine without a graphics card is slow; this only bounds a test that fails."""
OVERFLOW = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
WITHOUT_WEBGL = """const usual = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
        return kind.includes("webgl") ? null : usual.call(this, kind, ...more);
    };"""


class OpenedFile:
    """A page of a report, without WebGL, which takes seconds, unless asked for; `before` runs before the page's scripts."""

    def __init__(self, browser, path, size=LAPTOP, scheme="light", fragment="", before="", webgl=False, **more):
        self.path = path
        context = browser.new_context(viewport=size, color_scheme=scheme, **{"reduced_motion": "reduce", **more})
        context.set_default_timeout(1000 * PATIENCE_S)
        for script in filter(None, ("" if webgl else WITHOUT_WEBGL, before)):
            context.add_init_script(script)
        self.page, self.said, self.fetched = context.new_page(), [], []
        self.page.on("console", lambda one: self.said.append(one.text) if one.type == "error" else None)
        self.page.on("pageerror", lambda error: self.said.append(str(error)))
        self.page.on("dialog", lambda one: (self.said.append(f"dialog {one.message}"), one.dismiss()))
        self.page.on(
            "request", lambda one: self.fetched.append(one.url) if not one.url.startswith(("data:", "blob:")) else None
        )
        self.page.goto(path.as_uri() + fragment)

    def told(self, script):
        """What a script returns."""
        return self.page.evaluate(script)

    def until(self, condition):
        """Wait until a condition holds; the page's own policy forbids the browser's waiting functions."""
        end = time.monotonic() + PATIENCE_S
        while not self.told(condition):
            assert time.monotonic() < end, f"never: {condition}"
            self.page.wait_for_timeout(50)
