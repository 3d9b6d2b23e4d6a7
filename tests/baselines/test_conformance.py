"""Every method of the catalogue against the contract: being listed is being tested."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn

from baselines.ablations import PARTS_OF_QNERF, combination
from baselines.amplifiers import Amplifier
from baselines.catalog import CATALOG
from baselines.composition import Parts, encoding_bands, skip_layer
from baselines.contract import Box, NetworkSize, RadianceField, Rays, Rendering
from baselines.field import NetworkField
from baselines.nerf import NERF, NERF_MATCHED
from baselines.numerics.encoding import PHI, fourier_features
from baselines.qnerf import QNERF, QNERF_LISTING4
from baselines.rendering import Sampling, render_rays
from tests.baselines.analytic import rays_at

SMALL = NetworkSize(depth=4, width=32, colour_layers=2, colour_width=16, position_bands=6, direction_bands=2)
EIGHT = replace(SMALL, depth=8)
BOX = Box(torch.tensor([-1.0, -0.8, -1.2]), torch.tensor([1.0, 1.0, 0.8]))
WHITE = torch.ones(3)
UNAMPLIFIED = [name for name, method in CATALOG.items() if method.parts.amplifier == "none"]
AMPLIFIED = [name for name in CATALOG if name not in UNAMPLIFIED]

every_method = pytest.mark.parametrize("method", CATALOG)
every_depth = pytest.mark.parametrize("depth", [4, 5, 8])


def field_of(method: str, size: NetworkSize = SMALL, seed: int | str = 0, view_dependent: bool = True) -> NetworkField:
    return NetworkField(CATALOG[method].parts, size, BOX, "float32", seed, view_dependent)


def rays(count: int = 60) -> Rays:
    return rays_at(0.4, count, dtype=torch.float32)


def render(field: NetworkField, parts: Parts, some: Rays, generator: torch.Generator | None = None) -> Rendering:
    sampling = Sampling(bins=24, quadrature=parts.quadrature, clip_to_box=parts.quadrature != "listing4")
    return render_rays(field, None, some, BOX, sampling, None, WHITE, generator)


def points(count: int, seed: int = 60) -> tuple[Tensor, Tensor, Tensor]:
    """Positions, directions, and the direction that each position is seen from."""
    generator = torch.Generator().manual_seed(seed)
    x = BOX.from_unit(torch.rand(count, 3, generator=generator))
    d = torch.nn.functional.normalize(torch.randn(17, 3, generator=generator), dim=-1)
    return x, d, torch.randint(17, (count,), generator=generator)


def roughened(field: NetworkField, alpha: float | None = None) -> NetworkField:
    """As after training: a contrasted density, biases that are not zero, an amplifier that has moved."""
    generator = torch.Generator().manual_seed(61)
    with torch.no_grad():
        for name, weight in field.named_parameters():
            if name.endswith("bias"):
                weight.copy_(0.1 * torch.randn(weight.shape, generator=generator))
        field.density_head.weight *= 8.0
        if alpha is not None:
            field.amplifier.alpha.fill_(alpha)  # type: ignore[attr-defined]
    return field


@every_method
@every_depth
def test_builds_and_keeps_the_protocols(method: str, depth: int) -> None:
    field = field_of(method, replace(SMALL, depth=depth))
    assert isinstance(field, RadianceField)
    assert isinstance(field.amplifier, Amplifier)
    assert len(field.density_net) == depth
    assert CATALOG[method].title


@every_method
def test_weights_depend_on_the_seed_alone(method: str) -> None:
    one, same, other = field_of(method), field_of(method), field_of(method, seed=1)
    for (name, weight), again in zip(one.named_parameters(), same.parameters(), strict=True):
        assert torch.equal(weight, again), name
    assert not torch.equal(one.density_head.weight, other.density_head.weight)
    assert not torch.equal(one.density_head.weight, field_of(method, seed="0/fine").density_head.weight)


def test_building_leaves_the_global_generator_alone_in_effect() -> None:
    """Whatever torch's own initialisation draws, the weights do not depend on it."""
    torch.manual_seed(1)
    one = field_of("nerf")
    torch.manual_seed(2)
    for weight, again in zip(one.parameters(), field_of("nerf").parameters(), strict=True):
        assert torch.equal(weight, again)


def test_initial_weights_are_equal_between_methods_wherever_name_and_shape_are() -> None:
    reference = dict(field_of("nerf", EIGHT).named_parameters())
    for method in CATALOG:
        shared = [
            (name, weight)
            for name, weight in field_of(method, EIGHT).named_parameters()
            if name in reference and weight.shape == reference[name].shape
        ]
        assert len(shared) >= len(reference) - 3, method
        for name, weight in shared:
            assert torch.equal(weight, reference[name]), (method, name)


def test_initial_weights_are_glorot_uniform_with_zero_biases() -> None:
    for name, weight in field_of("nerf", replace(SMALL, width=128)).named_parameters():
        if weight.ndim == 1:
            assert (weight == 0).all(), name
        else:
            bound = (6.0 / (weight.shape[0] + weight.shape[1])) ** 0.5
            assert weight.abs().max() <= bound, name
            if weight.numel() > 1000:
                assert float(weight.detach().std()) == pytest.approx(bound / 3**0.5, rel=0.1), name


@every_method
@every_depth
@pytest.mark.parametrize("view_dependent", [True, False])
def test_renders_finite_colours_in_range(method: str, depth: int, view_dependent: bool) -> None:
    field = roughened(field_of(method, replace(SMALL, depth=depth), view_dependent=view_dependent))
    rendering = render(field, CATALOG[method].parts, rays())
    for values in (rendering.colour, rendering.opacity, rendering.depth):
        assert torch.isfinite(values).all()
    assert ((rendering.colour >= 0) & (rendering.colour <= 1 + 1e-5)).all()
    assert ((rendering.opacity >= 0) & (rendering.opacity <= 1 + 1e-5)).all()
    assert ((rendering.depth >= 2) & (rendering.depth <= 6)).all()


@every_method
def test_rendering_is_deterministic(method: str) -> None:
    field = roughened(field_of(method))
    for seed in (None, 3):
        one, two = (
            render(field, CATALOG[method].parts, rays(), None if seed is None else torch.Generator().manual_seed(seed))
            for _ in range(2)
        )
        assert torch.equal(one.colour, two.colour)
        assert torch.equal(one.depth, two.depth)


@every_method
@every_depth
def test_gradients_reach_every_parameter(method: str, depth: int) -> None:
    """β of Listing 2 among them, as something lies above its threshold here."""
    field = roughened(field_of(method, replace(SMALL, depth=depth)))
    (render(field, CATALOG[method].parts, rays()).colour ** 2).sum().backward()
    for name, weight in field.named_parameters():
        assert weight.grad is not None, name
        assert torch.isfinite(weight.grad).all(), name
        assert (weight.grad != 0).any(), name


def test_beta_gets_no_gradient_where_nothing_is_above_the_threshold() -> None:
    field = field_of("qnerf")
    with torch.no_grad():
        field.density_head.bias.fill_(-20.0)
    render(field, QNERF, rays()).colour.sum().backward()
    assert field.amplifier.beta.grad == 0.0  # type: ignore[attr-defined]


@pytest.mark.parametrize("method", UNAMPLIFIED)
@pytest.mark.parametrize("chunk", [1, 16, 50])
def test_chunks_do_not_matter_without_an_amplifier(method: str, chunk: int) -> None:
    field, some = roughened(field_of(method)), rays(100)
    whole = render(field, CATALOG[method].parts, some)
    parts = [render(field, CATALOG[method].parts, some.part(i, i + chunk)) for i in range(0, 100, chunk)]
    for name in ("colour", "opacity"):
        joined = torch.cat([getattr(part, name) for part in parts])
        torch.testing.assert_close(joined, getattr(whole, name), rtol=0.0, atol=2e-6)


@torch.no_grad()
def chunk_difference(field: NetworkField, method: str, chunk: int = 4) -> float:
    some, parts = rays(100), CATALOG[method].parts
    pieces = [render(field, parts, some.part(i, i + chunk)).colour for i in range(0, 100, chunk)]
    return float((torch.cat(pieces) - render(field, parts, some).colour).abs().max())


@pytest.mark.parametrize("method", AMPLIFIED)
def test_chunks_do_matter_with_an_amplifier_once_alpha_has_moved(method: str) -> None:
    """A documented property of the paper's operators: their mean is that of the call."""
    assert chunk_difference(roughened(field_of(method), alpha=1.0), method) > 1e-4


@pytest.mark.parametrize("method", [name for name in AMPLIFIED if name != "qnerf_listing4"])
def test_chunks_do_not_matter_at_the_initial_alpha(method: str) -> None:
    """Eq. 4 is the identity there, up to rounding about a mean that differs."""
    assert chunk_difference(roughened(field_of(method)), method) <= 1e-4


@pytest.mark.parametrize("method", AMPLIFIED)
def test_bounded_density_is_bounded(method: str) -> None:
    field = roughened(field_of(method), alpha=2.0)
    sigma = field.density(points(500)[0])
    assert (sigma >= 0).all()
    assert field.amplifier.bounded == (CATALOG[method].parts.amplifier == "listing2")
    if field.amplifier.bounded:
        assert (sigma <= 1).all()


# --- counts of Table 1 and places of the skip ------------------------------------------------------------------------


def linear_weights(*widths: int) -> int:
    """Weights and biases of a chain of linear layers."""
    return sum(inputs * outputs + outputs for inputs, outputs in zip(widths, widths[1:], strict=False))


@pytest.mark.parametrize(
    ("method", "position", "direction", "amplifier"),
    [("nerf", 63, 27, 0), ("nerf_matched", 45, 21, 0), ("qnerf", 63, 27, 2), ("qnerf_theorem", 63, 27, 1)],
)
def test_parameter_counts_at_the_size_of_the_paper(method: str, position: int, direction: int, amplifier: int) -> None:
    counts = field_of(method, NetworkSize()).parameter_counts()
    wide_input = linear_weights(256 + position, 256) - linear_weights(256, 256)
    assert counts == {
        "density_net": linear_weights(position, *[256] * 8) + wide_input,
        "density_head": 257,
        "colour_net": linear_weights(256 + direction, 128, 128, 3),
        "amplifier": amplifier,
        "total": sum(counts[name] for name in ("density_net", "density_head", "colour_net", "amplifier")),
    }
    if position == 63:
        assert (counts["density_net"], counts["colour_net"]) == (493_056, 53_251), "not Table 1's 1.3 M and 67 K"


@every_method
@every_depth
def test_counted_parameters_are_all_parameters(method: str, depth: int) -> None:
    field = field_of(method, replace(SMALL, depth=depth))
    assert field.parameter_counts()["total"] == sum(weight.numel() for weight in field.parameters())


@pytest.mark.parametrize(
    ("skip", "depth", "layer"),
    [("phi", 8, 6), ("phi", 6, 4), ("phi", 5, 4), ("phi", 4, 3), ("half", 8, 4), ("half", 4, 2)],
)
def test_layer_of_the_skip(skip: str, depth: int, layer: int) -> None:
    assert skip_layer(skip, depth) == layer
    if skip == "phi":
        assert layer == int(PHI * depth / 2), "Listing 3"


def test_phi_skip_of_depth_8_widens_the_eighth_layer() -> None:
    widths = [layer.in_features for layer in field_of("qnerf", NetworkSize()).density_net]  # type: ignore[union-attr]
    assert widths == [63, *[256] * 6, 319]


@pytest.mark.parametrize("depth", [4, 5])
def test_phi_skip_of_small_depths_reaches_the_heads(depth: int) -> None:
    field = field_of("qnerf", replace(SMALL, depth=depth))
    position, direction = 3 * 13, 3 * 5
    assert field.density_head.in_features == SMALL.width + position
    first = field.colour_net[0]
    assert isinstance(first, nn.Linear)
    assert first.in_features == SMALL.width + position + direction


def test_bandwidth_control_has_as_many_bands_as_the_paper_s_reach() -> None:
    assert encoding_bands("base2_matched", 10) == 7
    assert encoding_bands("base2", 10) == encoding_bands("phi", 10) == 10
    assert field_of("nerf_matched", NetworkSize()).position_ladder.tolist() == [2.0**k for k in range(7)]


# --- neutrality ------------------------------------------------------------------------------------------------------


def test_combinations_of_nothing_and_of_everything() -> None:
    assert combination() == NERF
    assert combination(*PARTS_OF_QNERF) == QNERF


def test_catalogue_holds_every_combination_once() -> None:
    parts = [method.parts for method in CATALOG.values()]
    assert len(set(parts)) == len(parts) == 8 + 3, "2³ combinations, the control, the theorem, listing 4"
    for part in PARTS_OF_QNERF.values():
        others = {name for name, method in CATALOG.items() if getattr(method.parts, part) == getattr(QNERF, part)}
        assert {"qnerf", "qnerf_listing4"} <= others


@pytest.mark.parametrize("name", PARTS_OF_QNERF)
def test_a_single_part_changes_that_part_alone(name: str) -> None:
    part = PARTS_OF_QNERF[name]
    assert replace(combination(name), **{part: getattr(NERF, part)}) == NERF


def trained(parts: Parts) -> NetworkField:
    """After three steps of Adam on random colours."""
    field = NetworkField(parts, SMALL, BOX, "float32", seed=5)
    optimiser = torch.optim.Adam(field.parameters(), lr=5e-3)
    truth = torch.rand(60, 3, generator=torch.Generator().manual_seed(62))
    for step in range(3):
        optimiser.zero_grad()
        colour = render(field, parts, rays(), torch.Generator().manual_seed(step)).colour
        torch.mean((colour - truth) ** 2).backward()
        optimiser.step()
    return field


@pytest.mark.parametrize("start", [QNERF, QNERF_LISTING4, NERF_MATCHED])
def test_with_every_part_put_back_training_is_nerf_bit_for_bit(start: Parts) -> None:
    back = replace(start, **{part: getattr(NERF, part) for part in ("encoding", "amplifier", "skip", "quadrature")})
    for one, two in zip(trained(NERF).parameters(), trained(back).parameters(), strict=True):
        assert torch.equal(one, two)
    assert not torch.equal(trained(NERF).density_head.weight, field_of("nerf", seed=5).density_head.weight)


# --- the field against a plain one -----------------------------------------------------------------------------------


def plain_field(field: NetworkField, parts: Parts, x: Tensor, d: Tensor, ray: Tensor) -> tuple[Tensor, Tensor]:
    """Listing 3 and the heads with every concatenation built, reading the parameters of `field`."""
    position = fourier_features(field.box.normalised(x), field.position_ladder)
    h = position
    for index, layer in enumerate(field.density_net):
        h = torch.relu(layer(h))
        if index == skip_layer(parts.skip, len(field.density_net)):
            h = torch.cat([h, position], dim=-1)
    sigma = field.amplifier.before_and_after(field.density_head(h).squeeze(-1))[1]
    if field.view_dependent:
        h = torch.cat([h, fourier_features(d, field.direction_ladder)[ray]], dim=-1)
    for layer in list(field.colour_net)[:-1]:
        h = torch.relu(layer(h))
    return sigma, torch.sigmoid(field.colour_net[-1](h))


@every_method
@every_depth
@pytest.mark.parametrize("view_dependent", [True, False])
def test_field_equals_a_plain_one_with_concatenations(method: str, depth: int, view_dependent: bool) -> None:
    parts = CATALOG[method].parts
    alpha = None if parts.amplifier == "none" else 0.9
    field = roughened(field_of(method, replace(SMALL, depth=depth), view_dependent=view_dependent), alpha)
    x, d, ray = points(700)
    sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
    expected_sigma, expected_colour = plain_field(field, parts, x, d, ray)
    torch.testing.assert_close(colour, expected_colour, rtol=0.0, atol=1e-6)
    torch.testing.assert_close(sigma, expected_sigma, rtol=2e-6, atol=2e-5)
    torch.testing.assert_close(field.density(x), sigma, rtol=1e-6, atol=1e-6)
    weights = [weight for name, weight in field.named_parameters() if not name.startswith("amplifier")]
    ours = torch.autograd.grad(colour.square().sum(), weights, allow_unused=True)
    plain = torch.autograd.grad(expected_colour.square().sum(), weights, allow_unused=True)
    for one, two in zip(ours, plain, strict=True):
        if two is not None:
            assert one is not None
            assert float((one - two).abs().max()) <= 2e-5 * max(1.0, float(two.abs().max()))


@pytest.mark.parametrize("count", [1, 5, 1023, 1024, 1025, 2500])
@pytest.mark.parametrize("method", ["nerf", "qnerf", "qnerf_theorem"])
def test_padding_is_not_seen(method: str, count: int) -> None:
    parts = CATALOG[method].parts
    field = roughened(field_of(method), None if parts.amplifier == "none" else 0.9)
    x, d, ray = points(count)
    sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
    expected_sigma, expected_colour = plain_field(field, parts, x, d, ray)
    assert sigma.shape == (count,)
    assert colour.shape == (count, 3)
    torch.testing.assert_close(colour, expected_colour, rtol=0.0, atol=1e-6)
    torch.testing.assert_close(sigma, expected_sigma, rtol=2e-6, atol=2e-5)


@every_method
def test_no_points_at_all(method: str) -> None:
    field = field_of(method)
    view = field.encode_directions(points(1)[1])
    sigma, colour = field.density_and_colour(torch.zeros(0, 3), view, torch.zeros(0, dtype=torch.long))
    assert sigma.shape == (0,)
    assert colour.shape == (0, 3)


@every_method
def test_without_view_dependence_directions_are_ignored(method: str) -> None:
    field = roughened(field_of(method, view_dependent=False))
    x, d, ray = points(200)
    colours = [
        field.density_and_colour(x, field.encode_directions(directions), ray)[1] for directions in (d, -d, 0 * d)
    ]
    assert torch.equal(colours[0], colours[1])
    assert torch.equal(colours[0], colours[2])


@every_method
def test_with_view_dependence_directions_change_colour_alone(method: str) -> None:
    field = roughened(field_of(method))
    x, d, ray = points(200)
    sigma, colour = field.density_and_colour(x, field.encode_directions(d), ray)
    other_sigma, other_colour = field.density_and_colour(x, field.encode_directions(-d), ray)
    assert torch.equal(sigma, other_sigma)
    assert not torch.allclose(colour, other_colour)


@every_method
def test_density_before_and_after_the_amplifier(method: str) -> None:
    field = roughened(field_of(method))
    before, after = field.density_before_and_after(points(300)[0])
    assert torch.equal(after, field.density(points(300)[0]))
    if method in UNAMPLIFIED:
        assert torch.equal(before, after)
    assert before.dtype == after.dtype == torch.float32


@every_method
def test_bfloat16_is_near_float32_and_keeps_float32_weights(method: str) -> None:
    parts = CATALOG[method].parts
    reduced, full = (roughened(NetworkField(parts, SMALL, BOX, precision, 0)) for precision in ("bfloat16", "float32"))
    x, d, ray = points(300)
    results = [field.density_and_colour(x, field.encode_directions(d), ray) for field in (reduced, full)]
    assert all(values.dtype == torch.float32 for values in results[0])
    assert all(weight.dtype == torch.float32 for weight in reduced.parameters())
    assert float((results[0][1] - results[1][1]).detach().abs().max()) <= 0.05
    results[0][1].sum().backward()
    assert all(weight.grad.dtype == torch.float32 for weight in reduced.colour_net.parameters())  # type: ignore[union-attr]


def test_what_an_encoding_sees_keeps_the_aspect_ratio() -> None:
    box = Box(torch.tensor([0.0, 0.0, 0.0]), torch.tensor([4.0, 2.0, 1.0]))
    corners = torch.tensor([[0.0, 0.0, 0.0], [4.0, 2.0, 1.0], [2.0, 1.0, 0.5]])
    assert box.normalised(corners).tolist() == [[-1.0, -0.5, -0.25], [1.0, 0.5, 0.25], [0.0, 0.0, 0.0]]
    assert torch.equal(box.from_unit(box.to_unit(corners)), corners)
