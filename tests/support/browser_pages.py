"""Pages in a browser: what tests and benchmarks of pages need."""

import time


class BrowserPage:
    """A page in the browser, with what it asked for and said."""

    def __init__(self, browser, address, **context):
        self.context = browser.new_context(**context)
        self.context.set_default_timeout(120_000)
        self.tab = self.context.new_page()
        self.requests, self.messages = [], []
        self.tab.on("request", lambda request: self._note(request.url))
        self.tab.on("console", lambda message: self.messages.append(message.text))
        self.tab.on("pageerror", lambda error: self.messages.append(str(error)))
        self.tab.goto(address)

    def _note(self, url):
        if not url.startswith("blob:"):  # a worker of the page's own text
            self.requests.append(url)

    def js(self, expression):
        """The value of an expression in which `page` is the page."""
        return self.tab.evaluate(
            "(async () => { const page = document.getElementById('kaju').page; "
            f"return page && ({expression}); }})()"
        )

    def until(self, expression, seconds=120):
        """Wait until an expression holds; the page's policy lets no string be polled in it."""
        end = time.monotonic() + seconds
        while not self.js(expression):
            assert time.monotonic() < end, f"not in {seconds} s: {expression}"
            self.tab.wait_for_timeout(10)

    def spot(self, expression):
        """Where a point of the picture is in the window."""
        self.js("page.draw()")
        box = self.tab.locator("canvas").first.bounding_box()
        x, y = self.js(expression)
        return box["x"] + x, box["y"] + y

    def at(self, cell):
        """Where a cell's middle is in the window."""
        return self.spot(f"page.view.at(...page.view.centre({list(cell)}))")

    def click(self, cell):
        self.tab.mouse.click(*self.at(cell))

    def press(self, name, exact=True):
        """Press a button."""
        self.tab.get_by_role("button", name=name, exact=exact).click()

    def text(self, selector):
        """What a part of the page says."""
        return self.tab.locator(selector).first.inner_text()

    def told(self):
        """The numbers of the story of what was clicked."""
        self.js("page.draw()")
        return self.tab.locator(".story data").evaluate_all("l => l.map((d) => Number(d.value))")
