"""Chromium as tests drive it: a page that is open, with every chart drawn, and what the browser said meanwhile."""

import shutil

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium: install its package")


def start_chromium():
    """Yield a browser, which ends with the tests of a file: while it runs, its thread has a loop of events."""
    with playwright.sync_playwright() as started:
        flags = ["--no-sandbox", "--use-gl=swiftshader", "--enable-unsafe-swiftshader"]
        chromium = started.chromium.launch(executable_path=CHROMIUM, args=flags)
        yield chromium
        chromium.close()


class Reader:
    """A page that is open, with every part unfolded and every chart drawn, and what the browser said meanwhile."""

    def __init__(self, browser, file, **settings):
        # the policy of a page forbids what playwright does to wait for a condition; test_hostile_names.py holds it
        self.page = browser.new_context(accept_downloads=True, bypass_csp=True, **settings).new_page()
        self.errors, self.requests = [], []
        self.page.on("console", lambda said: self.errors.append(said.text) if said.type == "error" else None)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(file.as_uri())
        self.folder = file.parent
        # A click goes beside a fold that a chart above, which is drawn meanwhile, moves between press and release.
        self.page.evaluate("document.querySelectorAll('details.fold').forEach((fold) => { fold.open = true; })")
        self.boxes = self.page.locator("[data-chart]")
        for k in range(self.boxes.count()):
            # A chart above that is drawn late may move this one out of the window again, so that it is never drawn.
            self.page.wait_for_function(
                """k => { const box = document.querySelectorAll('[data-chart]')[k];
                     box.scrollIntoView({ block: 'center' });
                     return box.dataset.drawn; }""",
                arg=k,
                timeout=60_000,
            )
            self.boxes.nth(k).locator(".plot").wait_for()

    def ranges(self, name, axis="xaxis"):
        return self.page.evaluate(
            "([name, axis]) => document.querySelector(`[data-chart=${name}] .plot`).layout[axis].range", [name, axis]
        )

    def press(self, name, button):
        self.page.bring_to_front()  # a page behind another may draw no frame, and a click waits for two
        self.page.locator(f"[data-chart={name}] button", has_text=button).first.click()

    def show(self, name):
        self.page.bring_to_front()
        self.page.locator(f"[data-chart={name}]").scroll_into_view_if_needed()

    def close(self):
        """Close the page, so that its charts take no time from the next."""
        self.page.context.close()

    def find_serious_faults(self):
        """Return what axe finds that is serious for a reader who does not see or point."""
        axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is missing")
        found = axe.Axe().run(self.page).response["violations"]
        return [(each["id"], each["impact"]) for each in found if each["impact"] in ("serious", "critical")]

    def find_overflow(self):
        """Return by how many pixels the page is wider than its window."""
        return self.page.evaluate("document.documentElement.scrollWidth - innerWidth")
