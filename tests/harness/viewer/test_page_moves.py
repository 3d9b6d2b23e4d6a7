"""What the page says while one moves, switches scenes or uses the keys; in a real browser."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from harness.viewer import engine
from harness.viewer.asked import Orbit
from harness.viewer.shown_run import ShownRun
from tests.harness.viewer.looking import Looking
from tests.harness.viewer.site import Site, served
from tests.harness.viewer.small_run import add_second_scene
from tests.reports.browsing import until

pytestmark = pytest.mark.slow


@pytest.fixture
def two(out: Path) -> Iterator[Site]:
    """Two scenes."""
    add_second_scene(out)
    with served(ShownRun.of(out, None, ["nerf"], 0, out / "none", None, torch.device("cpu"))) as found:
        yield found


def eye_of(place: dict[str, Any]) -> np.ndarray:
    orbit = Orbit(tuple(place["target"]), place["azimuth"], place["elevation"], place["distance"])
    return orbit.pose()[:3, 3]


def nearest(scene: dict[str, Any], place: dict[str, Any]) -> tuple[int, float]:
    """Its number from 1 on, and degrees."""
    centre = np.array(scene["centre"])
    arm = eye_of(place) - centre
    arms = [eye_of(view) - centre for view in scene["views"]]
    cosines = [float(arm @ one / np.linalg.norm(arm) / np.linalg.norm(one)) for one in arms]
    return int(np.argmax(cosines)) + 1, math.degrees(math.acos(max(cosines)))


@pytest.mark.parametrize("methods", [True, False])
def test_the_nearest_view_is_that_of_the_camera_with_and_without_methods(
    browser: Any, two: Site, methods: bool
) -> None:
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


def test_the_former_scene_is_not_shown_under_the_new_one_s_title(
    browser: Any, two: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever of it arrives late."""
    look = Looking(browser, two)
    refine = engine.refine
    monkeypatch.setattr(engine, "refine", lambda *rest: refine(*rest, rays_a_call=1))
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
