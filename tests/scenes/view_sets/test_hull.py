"""The hull of silhouettes: it holds the visible object and little else, and one bad mask has no effect."""

from pathlib import Path

import numpy as np
import pytest

from scenes.view_sets.source import CELLS, carved, covered, hull
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import pose, write_ball

SIZE, FOCAL = 100, 139.0
BOX = np.array([[-1.5, -1.5, -1.5], [1.5, 1.5, 1.5]])
RADIUS = 0.4
CENTRE = np.array([0.3, -0.2, 0.1])
POSES = np.array([pose(2.4 * i, -0.9 + 1.8 * i / 39) for i in range(40)])


def silhouette(camera: np.ndarray) -> np.ndarray:
    """The alpha of a ball, ray by ray."""
    row, column = np.indices((SIZE, SIZE)) + 0.5
    d = np.stack([(column - 0.5 * SIZE) / FOCAL, -(row - 0.5 * SIZE) / FOCAL, -np.ones((SIZE, SIZE))], axis=-1)
    d = (d / np.linalg.norm(d, axis=-1, keepdims=True)) @ camera[:3, :3].T
    to_centre = CENTRE - camera[:3, 3]
    along = d @ to_centre
    return (to_centre @ to_centre - along**2 < RADIUS**2).astype(np.float32)


ALPHAS = [silhouette(camera) for camera in POSES]


def distances(cells: int = CELLS) -> np.ndarray:
    """Return the distance from the middle of each cell of `BOX` to the centre of the ball."""
    axis = (np.arange(cells) + 0.5) / cells * 3.0 - 1.5
    return np.linalg.norm(np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1) - CENTRE, axis=-1)


@pytest.mark.parametrize("cells", [CELLS, 50])
def test_the_hull_of_a_ball_holds_it_and_little_else(cells: int) -> None:
    occupied = hull(BOX, ALPHAS, POSES, FOCAL, cells)
    cell = 3.0 / cells
    assert occupied[distances(cells) < RADIUS + 0.5 * cell].all()
    # a pixel at the distance of the ball is 0.03 wide; views of half a sphere leave little corners
    assert not occupied[distances(cells) > RADIUS + 6 * cell].any()
    assert RADIUS < carved(BOX, occupied)[1, 0] - CENTRE[0] < RADIUS + 6 * cell
    assert np.all(carved(BOX, occupied)[0] < CENTRE - RADIUS)


@pytest.mark.parametrize("bad", [0, 1])
def test_a_mask_in_fifty_may_be_wrong(bad: int) -> None:
    poses = np.concatenate([POSES, POSES[:10]])
    alphas = [np.zeros((SIZE, SIZE))] * (bad + 1) + (ALPHAS + ALPHAS[:10])[bad + 1 :]
    occupied = hull(BOX, alphas, poses, FOCAL)
    assert bool(occupied[distances() < RADIUS].all()) == (bad == 0)


def test_what_no_view_judges_or_sees_through_is_kept() -> None:
    behind = hull(BOX + np.array([0.0, 0.0, 50.0]), ALPHAS[:1], POSES[:1], FOCAL)
    assert behind.all()
    assert np.array_equal(carved(BOX, np.zeros((4, 4, 4), bool)), BOX)
    assert hull(BOX, [np.ones((SIZE, SIZE))] * len(POSES), POSES, FOCAL, cells=24).all()


def test_a_view_does_not_judge_cells_outside_its_picture() -> None:
    """Views cut to a strip leave more than complete views, and never less."""
    complete = hull(BOX, ALPHAS, POSES, FOCAL, cells=50)
    for strip in (np.s_[35:65, :], np.s_[:, 35:65]):
        kept = hull(BOX, [alpha[strip] for alpha in ALPHAS], POSES, FOCAL, cells=50)
        assert (kept | ~complete).all()
        assert kept.sum() > complete.sum()


def test_a_pixel_counts_as_covered_up_to_the_margin() -> None:
    alpha = np.zeros((9, 9))
    alpha[4, 4] = 1.0 / 255
    assert np.array_equal(covered(alpha, 2).nonzero(), np.ones((9, 9))[2:7, 2:7].nonzero() + np.array([[2], [2]]))
    assert not covered(np.full((3, 3), 0.4 / 255), 1).any()


def test_a_view_set_adopts_the_hull_that_another_process_has_of_it(tmp_path: Path) -> None:
    folder = write_ball(tmp_path / "ball", size=16, train=5, test=1)
    first, second = (read_view_set(folder, 16) for _ in range(2))
    packed = first.packed_hull
    assert 0.0 < first.hull.mean() < 1.0
    second.adopt_hull(packed)
    assert second.packed_hull == packed
    np.testing.assert_array_equal(second.hull, first.hull)
    second.adopt_hull(bytes(len(packed)))
    assert not second.hull.any(), "it is not computed again"
