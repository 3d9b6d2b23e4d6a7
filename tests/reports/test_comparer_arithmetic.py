"""The comparer's arithmetic in a real browser, compared with the harness's scoring programs and with NumPy."""

import json

import colour
import flip_evaluator
import numpy as np
import pytest

from harness.training.scoring import metrics
from reports.data.packing import depth, display, light
from scenes.view_sets.pixels import decode_srgb
from tests.reports.browsing import opened, until
from tests.reports.comparing import write_arithmetic_page

pytestmark = pytest.mark.slow

PLANES = """
const { width, height } = given;
const planesOf = async (ref) => {
  const [raw, meaning] = [await pixels.raw(ref, width, height), pixels.meanings(ref)];
  const all = Float32Array.from(raw, (number) => meaning[number]);
  const area = width * height;
  return Array.from({ length: ref.channels }, (_, which) => all.slice(which * area, (which + 1) * area));
};
Promise.all(given.pictures.map(planesOf)).then(async (loaded) => tell(await found(...loaded)));
"""
"""Load the given pictures, and tell the result of `found` for their planes."""
SHARMA = """50 2.6772 -79.7751 50 0 -82.7485 2.0425
50 -1.3802 -84.2814 50 0 -82.7485 1.0000
50 0 0 50 -1 2 2.3669
50 2.4900 -0.0010 50 -2.4900 0.0009 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0010 7.1792
50 2.4900 -0.0010 50 -2.4900 0.0011 7.2195
50 2.4900 -0.0010 50 -2.4900 0.0012 7.2195
50 -0.0010 2.4900 50 0.0009 -2.4900 4.8045
50 2.5 0 50 0 -2.5 4.3065
50 2.5 0 56 -27 -3 31.9030
50 2.5 0 58 24 15 19.4535
50 2.5 0 50 3.2592 0.3350 1.0000
60.2574 -34.0099 36.2677 60.4626 -34.1751 39.4387 1.2644
2.0776 0.0795 -1.1350 0.9033 -0.0636 -0.5514 0.9082"""
"""L a b L a b ΔE₀₀: pairs of table 1 of Sharma, Wu and Dalal 2005, on both sides of every branch."""


@pytest.fixture
def asked(browser, tmp_path):
    """Run a script after those of the page and return what it tells."""

    def ask(body, given, texts=()):
        path = write_arithmetic_page(tmp_path / "arithmetic.html", body, dict(texts), given)
        view, noise = opened(browser, path.as_uri())
        until(view, "document.title === 'done'", 60)
        assert noise == []
        return json.loads(view.inner_text("#found"))

    return ask


@pytest.fixture
def made_of(asked):
    """Run `found`, a function of the planes of packed pictures [h, w] or [h, w, 3]."""

    def ask(found, *pictures, **given):
        height, width, *_ = given.pop("size")
        given |= {"width": width, "height": height, "pictures": [picture.ref for picture in pictures]}
        return asked(f"const found = {found};{PLANES}", given, {picture.id: picture.text for picture in pictures})

    return ask


def eight_bit(picture):
    return np.round(255 * np.clip(picture, 0, 1)) / 255


@pytest.fixture(scope="module")
def pair():
    """Return truth and rendering in 8 bit: stripes, and noisy stripes with a corner of pure noise and a black spot."""
    y, x = np.mgrid[:40, :56]
    truth = np.stack([0.5 + 0.5 * np.sin(0.4 * x + 0.2 * y), 0.2 + 0.01 * y, 1 - 0.015 * x], -1)
    noise = np.random.default_rng(5)
    test = truth + noise.normal(0, 0.05, truth.shape)
    test[:9, :9] = noise.uniform(size=(9, 9, 3))
    test[30:36, 5:9] = 0
    return eight_bit(truth), eight_bit(test)


def test_decoded_pixels_are_the_packed_ones_bit_for_bit(asked):
    raws = [np.random.default_rng(channels).integers(0, 256, (13, 7, channels)) for channels in (1, 3)]
    packed = [display(raw / 255) for raw in raws]
    body = "Promise.all(given.map((ref) => pixels.raw(ref, 7, 13))).then((all) => tell(all.map((raw) => [...raw])));"
    found = asked(body, [picture.ref for picture in packed], {picture.id: picture.text for picture in packed})
    assert found == [raw.transpose(2, 0, 1).ravel().tolist() for raw in raws]


def test_a_reference_says_what_raw_numbers_mean(made_of):
    depths, lights = np.linspace(0, 5.5, 12).reshape(3, 4), np.geomspace(1e-3, 5e4, 36).reshape(3, 4, 3)
    tell = "(...pictures) => pictures.map((planes) => planes.map((plane) => [...plane]))"
    far, bright = made_of(tell, depth(depths, 5.5), light(lights), size=depths.shape)
    assert np.reshape(far, (3, 4)) == pytest.approx(depths, abs=5.5 / 4095)
    assert np.reshape(bright, (3, 3, 4)).transpose(1, 2, 0) == pytest.approx(lights, rel=1e-3, abs=1e-6)


def test_damaged_bytes_are_a_sentence(asked):
    texts = {"px0": "AAAA", "px1": "!!!", "px2": "eJwDAAAAAAE="}
    refs = [{"channels": 3, "bits": 8, "low": 0, "high": 1, "id": name} for name in texts]
    body = "Promise.all(given.map((ref) => pixels.raw(ref, 7, 13).catch((error) => error.message))).then(tell);"
    assert all(said.startswith("This picture cannot be shown: ") for said in asked(body, refs, texts))


def test_ciede2000_of_sharma_wu_and_dalal(asked):
    rows = [list(map(float, line.split())) for line in SHARMA.splitlines()]
    body = "tell(given.map((row) => deltaE.between(row.slice(0, 3), row.slice(3, 6))));"
    assert asked(body, rows) == pytest.approx([row[6] for row in rows], abs=5e-5)


def test_ciede2000_is_that_of_colour_science(made_of):
    first, second = eight_bit(np.random.default_rng(0).uniform(size=(2, 20, 30, 3)))
    second[:5] = first[:5]
    second[5:9] = eight_bit(first[5:9].mean(-1, keepdims=True).repeat(3, -1))
    labs = [colour.XYZ_to_Lab(colour.RGB_to_XYZ(decode_srgb(picture), "sRGB")) for picture in (first, second)]
    expected = colour.delta_E(*labs, method="CIE 2000")
    body = "async (one, other) => [...await chunks.run(deltaE.map(one, other, width, height))]"
    found = np.reshape(made_of(body, display(first), display(second), size=first.shape), (20, 30))
    assert found == pytest.approx(expected, abs=1e-4)
    assert found.mean() == pytest.approx(metrics.delta_e(second, first), abs=1e-5)


def test_flip_is_that_of_its_authors(made_of, pair):
    truth, test = pair
    reference, other = (picture.astype(np.float32) for picture in pair)
    expected, mean, _ = flip_evaluator.evaluate(reference, other, "LDR", inputsRGB=True, applyMagma=False)
    body = "async (truth, test) => [...await chunks.run(flip.map(truth, test, width, height))]"
    found = np.reshape(made_of(body, display(truth), display(test), size=truth.shape), (40, 56))
    assert np.max(expected) > 0.5
    # The authors' program uses single precision, and the root of a small difference magnifies its rounding.
    assert found == pytest.approx(np.asarray(expected)[..., 0], abs=1e-3)
    assert found.mean() == pytest.approx(mean, abs=2e-5)
    assert found.mean() == pytest.approx(metrics.flip(test, truth), abs=2e-5)


def test_maps_of_light_are_those_of_the_harness(made_of, pair):
    truth, test = (decode_srgb(picture).astype(np.float32) for picture in pair)
    truth[2:12, 20:40] *= 40.0
    truth = np.float32(np.float16(truth))
    reference, other = light(truth), display(pair[1])
    expected, mean, _ = flip_evaluator.evaluate(truth, test, "HDR", applyMagma=False)
    body = """async (lights, planes) => {
      const rendered = { width, height, light: planes.map((plane) => plane.map(colourSpace.decode)) };
      const pair = { test: rendered, truth: { ...rendered, light: lights } };
      const values = {};
      for (const name of ["rel_mse", "smape", "hdr_flip"]) {
        values[name] = [...await chunks.run(errorMaps.MAPS[name].work(pair))];
      }
      return values;
    }"""
    found = made_of(body, reference, other, size=truth.shape)
    assert np.max(expected) > 0.5
    assert np.reshape(found["hdr_flip"], (40, 56)) == pytest.approx(np.asarray(expected)[..., 0], abs=2e-3)
    assert np.mean(found["hdr_flip"]) == pytest.approx(mean, abs=1e-4)
    for name in ("rel_mse", "smape", "hdr_flip"):
        assert np.mean(found[name]) == pytest.approx(getattr(metrics, name)(test, truth), rel=2e-3, abs=1e-4), name


MAPS = """async (truth, test) => {
  const whole = (planes, depth) => ({ planes, width, height, depth: Float32Array.from(depth), opacity: given.opacity });
  const pair = { test: whole(test, given.depths[0]), truth: whole(truth, given.depths[1]), opaque: given.opacity };
  const told = { colour: [[], errorMaps.MAPS.colour.said(null, pair, { psnr: 30.005 })] };
  for (const name of ["signed", "absolute", "depth_error"]) {
    const values = await chunks.run(errorMaps.MAPS[name].work(pair));
    told[name] = [[...values], errorMaps.MAPS[name].said(values, pair, null)];
  }
  return told;
}"""


def test_maps_of_differences_are_numpys(made_of, pair):
    truth, test = pair
    rng = np.random.default_rng(2)
    depths, opacity = rng.uniform(1, 6, (2, 40, 56)), rng.uniform(0.97, 1, (40, 56))
    given = {"depths": depths.reshape(2, -1).tolist(), "opacity": opacity.ravel().tolist()}
    found = made_of(MAPS, display(truth), display(test), size=truth.shape, **given)
    difference = test - truth
    expected = {"signed": difference @ [0.2126, 0.7152, 0.0722], "absolute": np.abs(difference).mean(-1)}
    for name, values in expected.items():
        assert found[name][0] == pytest.approx(values.ravel().tolist(), abs=1e-6), name
    assert f"PSNR {metrics.psnr(test, truth):.2f} dB (record 30.0" in found["colour"][1]
    rmse = np.sqrt((difference**2).mean())
    assert found["signed"][1].endswith(f", RMSE of all channels {rmse:.4f}")
    values = np.array([np.nan if value is None else value for value in found["depth_error"][0]]).reshape(40, 56)
    opaque = opacity > 0.99
    assert (np.isnan(values) == ~opaque).all()
    assert values[opaque] == pytest.approx((depths[0] - depths[1])[opaque], abs=1e-6)
    said = found["depth_error"][1]
    assert said.startswith(f"RMSE {metrics.depth_rmse(depths[0], depths[1], opaque):.4f}")
