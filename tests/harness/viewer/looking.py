"""A page in a real browser that reaches nothing but this machine."""

from typing import Any

from tests.harness.viewer.site import Site


class Looking:
    """A page, its complaints, and its requests to other machines."""

    def __init__(self, browser: Any, site: Site, **context: Any) -> None:
        self.page = browser.new_context(**context).new_page()
        self.noise: list[str] = []
        self.page.on("console", lambda message: self.noise.append(message.text))
        self.page.on("pageerror", lambda error: self.noise.append(str(error)))
        self.page.route("**/*", lambda route: self._let(route, site))
        self.page.goto(site.address)
        self.ended()

    def _let(self, route: Any, site: Site) -> None:
        if route.request.url.startswith(site.address):
            route.continue_()
        else:
            self.noise.append(route.request.url)
            route.abort()

    def ended(self, generation: int = 0) -> int:
        """Wait for the end of a render after `generation`; returns the number of that render."""
        self.page.wait_for_selector("body[data-ended]", state="attached", timeout=60_000)
        while (ended := int(self.page.get_attribute("body", "data-ended"))) <= generation:
            self.page.wait_for_timeout(30)
        self.page.wait_for_timeout(60)  # what was drawn last is on the canvas
        return ended

    def after(self, act: Any) -> None:
        before = int(self.page.get_attribute("body", "data-ended"))
        act()
        self.ended(before)

    def picture(self, method: str) -> list[int]:
        return self.page.locator(f"figure[data-method={method}] canvas").evaluate(
            "canvas => [...canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data]"
        )

    def figure(self, method: str, key: str) -> str:
        return self.page.locator(f"figure[data-method={method}] dd[data-key={key}]").inner_text()

    def data(self, method: str, name: str) -> str | None:
        return self.page.locator(f"figure[data-method={method}]").get_attribute(f"data-{name}")
