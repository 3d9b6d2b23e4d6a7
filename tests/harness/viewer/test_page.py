"""The page in a real browser that reaches nothing but this machine."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.viewer import engine
from harness.viewer.requests import Orbit
from harness.viewer.shown_run import ShownRun
from tests.harness.viewer.conftest import HOSTILE, add_second_scene, shown_of
from tests.harness.viewer.site import ORBIT, Site, served
from tests.reports.browsing import until

pytestmark = pytest.mark.slow


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

    def title(self, method: str) -> str | None:
        return self.page.locator(f"figure[data-method={method}] dd[data-key=mean]").get_attribute("title")

    def data(self, method: str, name: str) -> str | None:
        return self.page.locator(f"figure[data-method={method}]").get_attribute(f"data-{name}")


@pytest.fixture
def site(shown: ShownRun) -> Iterator[Site]:
    with served(shown) as found:
        yield found


def test_a_trained_scene_is_looked_at(browser: Any, site: Site) -> None:
    look = Looking(browser, site, viewport={"width": 1200, "height": 800})
    page = look.page
    for method in ("nerf", "qnerf"):
        assert (look.data(method, "state"), look.data(method, "cached")) == ("whole", "none")
        assert len(set(look.picture(method))) > 20
        assert "own work" in look.figure(method, "coarse")
    assert "share a chunk" in page.locator("figure[data-method=qnerf] .note").inner_text()
    assert not page.locator("figure[data-method=nerf] .note").is_visible()

    # at a test view there is a score, and it is the engine's
    messages = site.messages(place={"view": 0}, client="beside", generation=1)
    scores = {header["method"]: header["psnr"] for header, _ in messages if header.get("state") == "whole"}
    for method, score in scores.items():
        assert float(look.data(method, "psnr") or "nan") == score
        assert look.figure(method, "psnr") == f"{score:.2f} dB"
    assert "test view 1 of 3" in page.locator("#place").inner_text()

    # orbit by keys and by drag: another picture, without a score
    before = look.picture("nerf")
    look.after(lambda: page.keyboard.press("ArrowRight"))
    turned = look.picture("nerf")
    assert turned != before
    assert "only at a view of the ground truth" in look.figure("nerf", "psnr")
    box = page.locator("figure[data-method=qnerf] canvas").bounding_box()

    def drag() -> None:
        page.mouse.move(box["x"] + 60, box["y"] + 60)
        page.mouse.down()
        page.mouse.move(box["x"] + 140, box["y"] + 90, steps=6)
        page.mouse.up()

    look.after(drag)
    page.wait_for_timeout(1500)  # the last of the drag's wishes
    assert look.picture("nerf") != turned
    dragged = look.picture("nerf")
    look.after(lambda: page.mouse.wheel(0, 200))
    assert look.picture("nerf") != dragged

    # back to where it began: out of the cache, the same picture
    look.after(lambda: page.click("#reset"))
    assert {look.data(method, "cached") for method in ("nerf", "qnerf")} <= {"memory"}
    assert look.figure("nerf", "state").startswith("view cache")
    assert look.picture("nerf") == before
    assert "served from it" in page.locator("#cache").inner_text()

    # other pictures of the same view
    shown = {"colour": look.picture("nerf")}
    for mode in ("depth", "opacity", "error"):
        page.locator(f"input[value={mode}]").check(force=True)
        page.wait_for_timeout(120)
        shown[mode] = look.picture("nerf")
        assert page.locator("#scale").is_visible()
    assert len({tuple(picture) for picture in shown.values()}) == 4
    grey = [shown["opacity"][at : at + 3] for at in range(0, len(shown["opacity"]), 4)]
    assert all(len(set(rgb)) == 1 for rgb in grey)
    page.locator("input[value=colour]").check(force=True)
    page.wait_for_timeout(120)
    assert look.picture("nerf") == before

    look.after(lambda: page.click("#next"))
    assert "test view 2 of 3" in page.locator("#place").inner_text()
    assert look.noise == []


def test_markup_in_names_is_text(browser: Any, site: Site) -> None:
    look = Looking(browser, site)
    assert HOSTILE in look.page.locator("h1").inner_text()
    assert HOSTILE in look.page.locator("figure[data-method=nerf] figcaption").inner_text()
    assert look.page.locator("img").count() == 0
    assert "taken" not in look.page.title()
    assert look.noise == []


def test_methods_are_loaded_when_chosen_and_one_that_cannot_be_shown_says_why(browser: Any, site: Site) -> None:
    look = Looking(browser, site)
    look.after(lambda: look.page.locator("input[value=nerf_matched]").check())
    assert look.data("nerf_matched", "state") == "failed"
    assert "was not trained" in look.page.locator("figure[data-method=nerf_matched] .over").inner_text()
    assert look.title("nerf_matched") == "was not trained"
    assert look.title("nerf").endswith(" s of training")
    look.after(lambda: look.page.locator("input[value=qnerf]").uncheck())
    assert look.page.locator("figure[data-method=qnerf]").count() == 0
    assert look.data("nerf", "state") == "whole"
    assert look.noise == []


@pytest.mark.parametrize("unit", [1e-5, 1e5])
def test_a_scene_in_any_unit_can_be_looked_at_from_all_distances(browser: Any, site: Site, unit: float) -> None:
    look = Looking(browser, site)
    reach = "unit => import('/camera.js').then(camera => camera.reach([{ distance: unit }]))"
    assert look.page.evaluate(reach, unit) == pytest.approx([unit / 16, 16 * unit])
    assert site.render(place={**ORBIT, "distance": unit, "target": [unit, 0.0, 0.0]})[0] == 200
    assert look.noise == []


@pytest.fixture
def two(out: Path) -> Iterator[Site]:
    add_second_scene(out)
    with served(shown_of(out, ["nerf"])) as found:
        yield found


def eye_of(place: dict[str, Any]) -> np.ndarray:
    orbit = Orbit(tuple(place["target"]), place["azimuth"], place["elevation"], place["distance"])
    return orbit.pose()[:3, 3]


def nearest(scene: dict[str, Any], place: dict[str, Any]) -> tuple[int, float]:
    """Its number from 1 on, and degrees."""
    centre = np.array(scene["centre"])
    arm = eye_of(place) - centre
    arms = [eye_of(view) - centre for view in scene["views"]]
    cosines = [float(arm @ other / np.linalg.norm(arm) / np.linalg.norm(other)) for other in arms]
    return int(np.argmax(cosines)) + 1, math.degrees(math.acos(max(cosines)))


@pytest.mark.parametrize("methods", [True, False])
def test_the_nearest_view_is_that_of_the_camera_with_or_without_methods(browser: Any, two: Site, methods: bool) -> None:
    look = Looking(browser, two)
    scene = two.json("/scene.json?scene=ball")
    place = {name: scene["views"][0][name] for name in ("azimuth", "elevation", "distance", "target")}
    if not methods:
        look.page.locator("input[value=nerf]").uncheck()
        look.page.locator("figure.truth canvas").focus()
    for _ in range(9):
        look.page.keyboard.press("ArrowRight")
        place["azimuth"] += math.pi / 36
        number, degrees = nearest(scene, place)
        wanted = f"nearest: test view {number} of 3, {degrees:.1f}° away"
        assert wanted in look.page.locator("#place").inner_text()
    look.page.wait_for_timeout(500)
    assert f"nearest, {degrees:.1f}° away" in look.page.locator("figure.truth dd[data-key=state]").inner_text()
    look.page.keyboard.press("n")
    assert f"At test view {number} of 3" in look.page.locator("#place").inner_text()
    assert look.noise == []


def test_a_former_scene_never_has_the_new_title(browser: Any, two: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever of it arrives late."""
    look = Looking(browser, two)
    refine = engine.refine
    monkeypatch.setattr(engine, "refine", lambda *rest: refine(*rest, least_rays=1))
    look.page.evaluate(
        """() => {
          window.late = []
          const fetched = window.fetch
          window.fetch = async (address, options) => {
            const answer = await fetched(address, { ...options, signal: undefined })  // an abort that comes too late
            if (!options?.body) return answer
            const { scene } = JSON.parse(options.body)
            const reader = answer.body.getReader()
            const title = () => document.querySelector('h1').textContent
            const read = async () => {
              while (scene !== 'second' && window.late.length && !title().startsWith('second'))
                await new Promise(done => setTimeout(done, 5))  // all but the first piece come late
              const found = await reader.read()
              window.late.push([scene, title()])
              return found
            }
            return { ok: true, body: { getReader: () => ({ read }) } }
          }
        }"""
    )
    look.page.keyboard.press("ArrowUp")
    until(look.page, "window.late.length > 0")
    look.after(lambda: look.page.select_option("#scene", "second"))
    late = look.page.evaluate("() => window.late.filter(([scene, title]) => !title.startsWith(scene)).length")
    assert late > 0  # pieces of the former scene did arrive under the new title
    second = two.messages(scene="second", methods=["nerf"], place={"view": 0}, client="beside")
    score = next(header["psnr"] for header, _ in second if header.get("state") == "whole")
    assert look.figure("nerf", "psnr") == f"{score:.2f} dB"
    assert look.data("nerf", "state") == "whole"
    assert look.noise == []
