"""Random maps of the box: what is certified to be a solid is built, what folds is refused.

Nothing here asks the compiler under test for a figure to compare with: volumes are mean Bernstein
coefficients of det J in whole numbers, areas are Gauss sums over the control points.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from math import comb, pi

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import pc2cad as pc
from pc2cad.errors import NotASolidError
from pc2cad.part import Part
from pc2cad.report import Report

U, V, W = pc.parameters()
SETTINGS = {
    "deadline": None,
    "derandomize": True,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
    "print_blob": False,
}
#: perturbations are whole multiples of this
STEP = Fraction(1, 64)


def few(count: int) -> Callable:
    return settings(max_examples=count, **SETTINGS)


# -- polynomial bricks -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Brick:
    """Bernstein control points in whole multiples of STEP, (l + 1, m + 1, n + 1, 3)."""

    net: tuple

    @property
    def array(self) -> np.ndarray:
        return np.array(self.net, dtype=object)

    @property
    def degrees(self) -> tuple[int, int, int]:
        return tuple(n - 1 for n in self.array.shape[:3])

    def coordinates(self, u=U, v=V, w=W) -> tuple:
        """The equation at (u, v, w), as trees."""
        bases = [bernstein(n, t) for n, t in zip(self.degrees, (u, v, w), strict=True)]
        net = self.array
        rows = []
        for axis in range(3):
            total = pc.parameters()[0] * 0
            for i, j, k in np.ndindex(*net.shape[:3]):
                value = STEP * int(net[i, j, k, axis])
                total = total + bases[0][i] * bases[1][j] * bases[2][k] * value
            rows.append(total)
        return tuple(rows)

    def moved(self, matrix, offset=(0, 0, 0)) -> Brick:
        """The affine image of the brick (whole numbers)."""
        net = self.array @ np.array(matrix, dtype=object).T + np.array(offset, dtype=object)
        return brick_of(net)

    def determinant(self) -> np.ndarray:
        """Bernstein coefficients of det J, exact."""
        u, v, w = (difference(self.array, axis) for axis in range(3))
        total = 0
        for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            minor = convolve(v[..., b], w[..., c]) - convolve(v[..., c], w[..., b])
            total = total + convolve(u[..., a], minor)
        weights = np.array([
            math.prod(comb(n - 1, i) for n, i in zip(total.shape, index, strict=True))
            for index in np.ndindex(*total.shape)
        ], dtype=object).reshape(total.shape)  # fmt: skip
        return np.vectorize(Fraction, otypes=[object])(total, weights) * STEP**3

    def volume(self) -> Fraction:
        """The signed volume: the mean Bernstein coefficient of det J."""
        coefficients = self.determinant()
        return coefficients.sum() / coefficients.size

    def area(self) -> float:
        """The area of the six sides, by Gauss."""
        net = self.array.astype(float) * float(STEP)
        total = 0.0
        for axis, end in product(range(3), (0, -1)):
            total += side_area(np.take(net, end, axis=axis))
        return total

    def smallest_determinant(self, places: int = 17) -> tuple[float, float]:
        """The least and the largest det J on a dense grid (double precision)."""
        net = self.array.astype(float) * float(STEP)
        t = np.linspace(0, 1, places)
        columns = []
        for axis in range(3):
            d = self.degrees[axis] * np.diff(net, axis=axis)
            bases = [np.array([values(n - 1, t)]).reshape(n, -1) for n in d.shape[:3]]
            columns.append(np.einsum("ia,jb,kc,ijkx->abcx", *bases, d))
        det = np.einsum("...i,...i->...", columns[0], np.cross(columns[1], columns[2]))
        return float(det.min()), float(det.max())


def brick_of(net: np.ndarray) -> Brick:
    def plain(a):
        return tuple(plain(b) for b in a) if isinstance(a, np.ndarray) else int(a)

    return Brick(plain(net))


def bernstein(n: int, t) -> list:
    return [comb(n, i) * t**i * (1 - t) ** (n - i) for i in range(n + 1)]


def values(n: int, t: np.ndarray) -> list[np.ndarray]:
    return [comb(n, i) * t**i * (1 - t) ** (n - i) for i in range(n + 1)]


def scaled(c: np.ndarray) -> np.ndarray:
    for axis, n in enumerate(c.shape[:3]):
        row = np.array([comb(n - 1, i) for i in range(n)], dtype=object)
        shape = [1] * c.ndim
        shape[axis] = n
        c = c * row.reshape(shape)
    return c


def difference(net: np.ndarray, axis: int) -> np.ndarray:
    """Bernstein coefficients of a derivative, times their binomials."""
    return scaled(np.diff(net, axis=axis) * (net.shape[axis] - 1))


def convolve(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    result = np.zeros([a + b - 1 for a, b in zip(p.shape, q.shape, strict=True)], dtype=object)
    for index in np.ndindex(*p.shape):
        window = tuple(slice(i, i + n) for i, n in zip(index, q.shape, strict=True))
        result[window] += p[index] * q
    return result


def side_area(net: np.ndarray) -> float:
    x, weights = np.polynomial.legendre.leggauss(16)
    # graded towards the ends: the normal may nearly vanish in a corner
    grades = [2.0**-k for k in range(2, 11)]
    ends = np.array([0.0, *grades[::-1], 0.5, *(1 - g for g in grades), 1.0])
    half = np.diff(ends)[:, None] / 2
    t = (ends[:-1, None] + half + half * x).ravel()
    weights = (half * weights).ravel()
    n, m = (k - 1 for k in net.shape[:2])
    b, c = np.array(values(n, t)), np.array(values(m, t))
    db, dc = (np.array(values(k - 1, t)).reshape(k, -1) for k in (n, m))
    along = np.einsum("ia,jb,ijx->abx", db, c, n * np.diff(net, axis=0))
    across = np.einsum("ia,jb,ijx->abx", b, dc, m * np.diff(net, axis=1))
    normal = np.cross(along, across)
    return float(weights @ np.sqrt((normal**2).sum(-1)) @ weights)


def grid(degrees: tuple[int, int, int]) -> np.ndarray:
    """The regular control net of the unit cube, in units of STEP."""
    unit = int(1 / STEP)
    axes = [np.array([unit * i // n for i in range(n + 1)], dtype=object) for n in degrees]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


@st.composite
def bricks(draw, most: Callable[[tuple[int, int, int]], int] | int | None = None) -> Brick:
    """A regular net plus a perturbation; by default one so small that J - 1 has a norm below 1.

    Entries of J - 1 are means of n·(difference of neighbours) <= 2 n a, so that a < 1/(6n) makes
    |M(p) - M(q) - (p - q)| < |p - q| on the (convex) cube: the map is injective.
    """
    degrees = draw(st.sampled_from([(1, 1, 1), (2, 2, 2), (1, 2, 1), (2, 1, 2)]))
    unit = int(1 / STEP)
    bound = most if most is not None else -(-unit // (6 * max(degrees))) - 1
    net = grid(degrees)
    flat = draw(st.lists(st.integers(-bound, bound), min_size=net.size, max_size=net.size))
    return brick_of(net + np.array(flat, dtype=object).reshape(net.shape))


def assert_solid(part: Part, volume: float, area: float | None, faces: int, exact: bool) -> None:
    report = part.report
    # doubles far from the origin are that far apart, all over the surface
    apart = np.spacing(np.abs(report.equation.centroid).max()) * report.equation.area / volume
    relative = max(1e-12, apart) if exact else 1e-7
    assert report.evidence == ("exact" if exact else "sampled")
    assert report.equation.volume == pytest.approx(volume, rel=1e-12, abs=0)
    assert report.solid.volume == pytest.approx(volume, rel=relative, abs=0)
    if area is not None:
        assert report.equation.area == pytest.approx(area, rel=1e-10, abs=0)
        assert report.solid.area == pytest.approx(area, rel=max(relative, 1e-10), abs=0)
    assert len(report.faces) == faces
    assert report.deviation <= report.tolerance


def check_volume(report: Report, volume: float) -> None:
    """A thin body may lose what the stated deviation makes over the whole area, and no more."""
    assert report.equation.volume == pytest.approx(volume, rel=1e-11, abs=0)
    slack = report.deviation * report.solid.area / volume + 1e-9
    assert report.solid.volume == pytest.approx(volume, rel=slack, abs=0)
    assert report.deviation <= report.tolerance


def check_brick(brick: Brick) -> None:
    part = pc.compile_part(brick.coordinates())
    assert_solid(part, float(abs(brick.volume())), brick.area(), 6, exact=True)
    assert (part.report.edges, part.report.vertices, part.report.euler) == (12, 8, 2)
    assert all(face.deviation == 0 for face in part.report.faces)
    assert part.report.solid.area == pytest.approx(brick.area(), rel=1e-11, abs=0)


def test_volume_by_bernstein_coefficients():
    net = grid((2, 2, 2))
    assert brick_of(net).volume() == 1
    twice = brick_of(net).moved([[2, 0, 0], [1, 1, 0], [0, 5, 3]], (7, 8, 9))
    assert twice.volume() == 6
    assert brick_of(grid((1, 2, 1))).area() == pytest.approx(6, rel=1e-15)


@few(2)
@given(bricks())
def test_small_perturbations_are_built_exactly(brick):
    check_brick(brick)


@pytest.mark.slow
@few(20)
@given(bricks())
def test_many_small_perturbations_are_built_exactly(brick):
    check_brick(brick)


def check_proved_or_refused(brick: Brick) -> None:
    """Whatever the perturbation: a proved sign of det J is true, and the volume is right."""
    least, most = brick.smallest_determinant()
    folds = least < -1e-3 * most and most > 1e-3 * -least
    part, refusal = None, None
    try:
        part = pc.compile_part(brick.coordinates())
    except NotASolidError as error:
        refusal = error
    if part is None:
        assert "\n" not in str(refusal)
        assert "nan" not in str(refusal)
        coefficients = brick.determinant()
        if (coefficients > 0).all() or (coefficients < 0).all():
            # locally injective: then it has to be an overlap
            assert type(refusal).__name__ == "OverlappingMapError"
        return
    assert not folds
    # areas of sides that nearly fold lose digits: see the test on nearly flat corners
    assert_solid(part, float(abs(brick.volume())), None, 6, exact=True)
    assert part.report.solid.area == pytest.approx(brick.area(), rel=1e-6, abs=0)


@few(2)
@given(bricks(most=24))
def test_larger_perturbations_are_right_or_refused(brick):
    check_proved_or_refused(brick)


@pytest.mark.slow
@few(12)
@given(bricks(most=24))
def test_many_larger_perturbations_are_right_or_refused(brick):
    check_proved_or_refused(brick)


def test_area_of_a_side_that_is_nearly_flat_in_a_corner_keeps_its_digits():
    net = grid((2, 1, 2))
    rows = [((8, -21, 0), (11, 16, 48), (14, -10, 45)), ((52, 7, 0), (20, -8, 32), (14, -8, 69))]
    for i, row in enumerate(rows):
        net[i, 0] = np.array(row, dtype=object)
    brick = brick_of(net)
    report = pc.compile_part(brick.coordinates()).report
    # Gauss sums on refined panels agree on 5.88704572107038 to all digits
    assert brick.area() == pytest.approx(5.88704572107038, rel=1e-12)
    assert report.equation.area == pytest.approx(5.88704572107038, rel=1e-12)
    assert report.solid.area == pytest.approx(5.88704572107038, rel=1e-11)


@pytest.mark.slow
@few(8)
@given(bricks(most=80))
def test_wild_perturbations_are_right_or_refused(brick):
    check_proved_or_refused(brick)


# -- the same solid, written differently -----------------------------------------------------------

orders = st.permutations(range(3))
turns = st.tuples(st.booleans(), st.booleans(), st.booleans())
matrices = st.lists(st.lists(st.integers(-3, 3), min_size=3, max_size=3), min_size=3, max_size=3)
matrices = matrices.filter(lambda m: abs(np.linalg.det(m)) > 0.9)
offsets = st.tuples(*[st.integers(-10_000, 10_000)] * 3)


def renamed(order, turned) -> list:
    names = [(U, V, W)[i] for i in order]
    return [1 - t if turn else t for t, turn in zip(names, turned, strict=True)]


def check_renamed(brick: Brick, order, turned) -> None:
    part = pc.compile_part(brick.coordinates(*renamed(order, turned)))
    assert_solid(part, float(abs(brick.volume())), brick.area(), 6, exact=True)


@few(2)
@given(bricks(), orders, turns)
def test_permuted_and_reversed_parameters(brick, order, turned):
    check_renamed(brick, order, turned)


@few(2)
@given(bricks(), matrices, offsets)
def test_affine_images(brick, matrix, offset):
    check_affine(brick, matrix, offset)


def check_affine(brick: Brick, matrix, offset) -> None:
    image = brick.moved(matrix, offset)
    volume = abs(brick.volume()) * abs(round(np.linalg.det(matrix)))
    assert abs(image.volume()) == volume
    part = pc.compile_part(image.coordinates())
    assert_solid(part, float(volume), image.area(), 6, exact=True)


CHANGES = {
    "(t+t²)/2": (lambda t: (t + t**2) / 2, True),
    "1-(1-t)²": (lambda t: 1 - (1 - t) ** 2, True),
    "t³": (lambda t: t**3, True),
    "3t²-2t³": (lambda t: 3 * t**2 - 2 * t**3, True),
    "(eᵗ-1)/(e-1)": (lambda t: (pc.exp(t) - 1) / (pc.e - 1), False),
    "sin(πt/2)": (lambda t: pc.sin(pc.pi * t / 2), False),
    "(1-cos πt)/2": (lambda t: (1 - pc.cos(pc.pi * t)) / 2, False),
    "2t/(1+t)": (lambda t: 2 * t / (1 + t), False),
    "tan(πt/4)": (lambda t: pc.tan(pc.pi * t / 4), False),
}


def check_reparametrised(brick: Brick, change: str, direction: int) -> None:
    function, polynomial = CHANGES[change]
    local = [U, V, W]
    local[direction] = function(local[direction])
    part = pc.compile_part(brick.coordinates(*local))
    volume, area = float(abs(brick.volume())), brick.area()
    report = part.report
    assert len(report.faces) == 6
    assert report.equation.volume == pytest.approx(volume, rel=1e-12, abs=0)
    assert report.equation.area == pytest.approx(area, rel=1e-10, abs=0)
    relative = 1e-12 if polynomial else 1e-7
    assert report.solid.volume == pytest.approx(volume, rel=relative, abs=0)
    assert report.solid.area == pytest.approx(area, rel=max(relative, 1e-10), abs=0)
    if polynomial:
        assert report.evidence == "exact"


@pytest.mark.parametrize("change", CHANGES)
@few(1)
@given(bricks(), st.integers(0, 2))
def test_smooth_change_of_one_parameter(change, brick, direction):
    check_reparametrised(brick, change, direction)


@pytest.mark.slow
@few(6)
@given(bricks(), st.sampled_from(sorted(CHANGES)), st.integers(0, 2))
def test_smooth_change_of_one_parameter_often(brick, change, direction):
    check_reparametrised(brick, change, direction)


@pytest.mark.slow
@few(8)
@given(bricks(), matrices, offsets)
def test_affine_images_often(brick, matrix, offset):
    check_affine(brick, matrix, offset)


@pytest.mark.slow
@few(8)
@given(bricks(), orders, turns)
def test_permuted_and_reversed_parameters_often(brick, order, turned):
    check_renamed(brick, order, turned)


# -- folds -----------------------------------------------------------------------------------------


@st.composite
def folded_bricks(draw) -> Brick:
    brick = draw(bricks(most=96))
    least, most = brick.smallest_determinant()
    # both signs beyond doubt, on an independent grid
    if min(-least, most) < 0.02 * max(-least, most):
        net = brick.array.copy()
        # pull one corner through the opposite one
        net[0, 0, 0] = net[-1, -1, -1] * 2 - net[0, 0, 0]
        brick = brick_of(net)
    return brick


def check_folded(brick: Brick) -> None:
    least, most = brick.smallest_determinant()
    if min(-least, most) < 0.02 * max(-least, most):
        return
    with pytest.raises(NotASolidError) as caught:
        pc.compile_part(brick.coordinates())
    assert "\n" not in str(caught.value)
    assert "nan" not in str(caught.value)


@few(2)
@given(folded_bricks())
def test_folds_are_refused(brick):
    check_folded(brick)


@pytest.mark.slow
@few(8)
@given(folded_bricks())
def test_many_folds_are_refused(brick):
    check_folded(brick)


# -- collapsed sides -------------------------------------------------------------------------------


def collapsed(brick: Brick, axis: int, end: int, keep: int | None) -> Brick:
    """The brick with one side made a point, or a curve along one of its own two axes."""
    net = np.moveaxis(brick.array.copy(), axis, 0)
    side = net[end]
    if keep is None:
        side[...] = side[:1, :1]
    else:
        side[...] = side[:, :1] if keep == 0 else side[:1, :]
    net[end] = side
    return brick_of(np.moveaxis(net, 0, axis))


@st.composite
def collapsed_bricks(draw) -> tuple[Brick, int]:
    brick = draw(bricks(most=4))
    axis, end = draw(st.integers(0, 2)), draw(st.sampled_from([0, -1]))
    keep = draw(st.sampled_from([None, 0, 1]))
    return collapsed(brick, axis, end, keep), 5


def check_collapsed(brick: Brick, faces: int) -> None:
    coefficients = brick.determinant()
    if not ((coefficients >= 0).all() or (coefficients <= 0).all()):
        return
    part = pc.compile_part(brick.coordinates())
    assert_solid(part, float(abs(brick.volume())), brick.area(), faces, exact=True)
    assert part.report.determinant == "proved"


@few(2)
@given(collapsed_bricks())
def test_sides_collapsed_to_points_and_curves(case):
    check_collapsed(*case)


@pytest.mark.slow
@few(30)
@given(collapsed_bricks())
def test_sides_collapsed_often(case):
    check_collapsed(*case)


small = st.integers(1, 12).map(lambda k: Fraction(k, 4))


@pytest.mark.slow
@few(8)
@given(matrices, offsets, small, small, small, st.sampled_from([1, 2, 3]))
def test_cones_over_ellipses_with_apex_of_any_order(matrix, offset, a, b, h, order):
    slow = W**order
    c, s = pc.cos(2 * pc.pi * U), pc.sin(2 * pc.pi * U)
    local = (a * V * slow * c, b * V * slow * s, h * slow)
    part = pc.compile_part(affine(local, matrix, offset))
    volume = float(pi * a * b * h / 3) * abs(round(np.linalg.det(matrix)))
    assert_solid(part, volume, None, 2, exact=True)
    assert part.report.euler == 2


def affine(local, matrix, offset=(0, 0, 0)) -> tuple:
    return tuple(
        sum((int(k) * x for k, x in zip(row, local, strict=True)), start=U * 0) + int(shift)
        for row, shift in zip(matrix, offset, strict=True)
    )


# -- rings, tubes, sectors -------------------------------------------------------------------------

RIGID = [np.array(m) for m in ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 0, 1], [1, 0, 0], [0, 1, 0]],
                               [[0, -1, 0], [1, 0, 0], [0, 0, 1]], [[-1, 0, 0], [0, 1, 0],
                                                                    [0, 0, 1]])]  # fmt: skip
places = st.tuples(st.sampled_from(range(len(RIGID))), orders, turns, offsets)


def placed(local: Callable, place) -> tuple:
    index, order, turned, offset = place
    return affine(local(*renamed(order, turned)), RIGID[index], offset)


@pytest.mark.parametrize("quarters", [0, 1, 3, 6])
@few(2)
@given(places, st.integers(3, 20), small)
def test_square_section_turned_by_quarters(quarters, place, radius, side):
    R = radius + 2 * side

    def ring(u, v, w):
        beta, theta = quarters * pc.pi * u / 2, 2 * pc.pi * u
        a, b = side * (2 * v - 1), side * (2 * w - 1)
        x = a * pc.cos(beta) - b * pc.sin(beta)
        y = a * pc.sin(beta) + b * pc.cos(beta)
        return (R + x) * pc.cos(theta), (R + x) * pc.sin(theta), y

    part = pc.compile_part(placed(ring, place))
    report = part.report
    check_volume(report, float(2 * pi * R * 4 * side**2))
    assert len(report.faces) == 4
    assert report.genus == (1,)
    assert report.euler == 0
    glued = [side for side in report.sides if side.fate == "interface"]
    assert len(glued) == 2


@pytest.mark.slow
@few(8)
@given(places, st.integers(2, 9), small, small, st.integers(1, 9), st.integers(-2, 2))
def test_tubes_with_voids(place, gap, a, b, inner, twist):
    R = max(a, b) + gap
    hollow = Fraction(inner, 10)

    def tube(u, v, w):
        theta, phi, turn = 2 * pc.pi * u, 2 * pc.pi * v, 2 * pc.pi * u * twist
        r = hollow + (1 - hollow) * w
        p, q = a * r * pc.cos(phi), b * r * pc.sin(phi)
        x = p * pc.cos(turn) - q * pc.sin(turn)
        y = p * pc.sin(turn) + q * pc.cos(turn)
        return (R + x) * pc.cos(theta), (R + x) * pc.sin(theta), y

    part = pc.compile_part(placed(tube, place))
    volume = float(2 * pi * R * pi * a * b * (1 - hollow**2))
    check_volume(part.report, volume)
    assert part.report.genus == (1, 1)
    assert len(part.report.faces) == 2


@few(2)
@given(matrices, offsets, st.integers(1, 9), st.permutations(range(3)))
def test_hollow_ellipsoids(matrix, offset, inner, order):
    check_hollow_ellipsoid(matrix, offset, inner, order)


@pytest.mark.slow
@few(12)
@given(matrices, offsets, st.integers(1, 9), st.permutations(range(3)))
def test_hollow_ellipsoids_often(matrix, offset, inner, order):
    check_hollow_ellipsoid(matrix, offset, inner, order)


def check_hollow_ellipsoid(matrix, offset, inner, order) -> None:
    hollow = Fraction(inner, 10)
    u, v, w = ((U, V, W)[i] for i in order)
    r = hollow + (1 - hollow) * w
    theta = 2 * pc.pi * u
    local = (r * pc.sin(pc.pi * v) * pc.cos(theta), r * pc.sin(pc.pi * v) * pc.sin(theta),
             r * pc.cos(pc.pi * v))  # fmt: skip
    part = pc.compile_part(affine(local, matrix, offset))
    volume = float(4 * pi / 3 * (1 - hollow**3)) * abs(round(np.linalg.det(matrix)))
    check_volume(part.report, volume)
    assert part.report.genus == (0, 0)


SHARES = [Fraction(1, 2), Fraction(3, 4), Fraction(1, 8), Fraction(99, 100)]


@pytest.mark.parametrize("share", SHARES, ids=str)
@few(3)
@given(places, st.integers(1, 9), small, small, st.integers(0, 9))
def test_sectors_of_tubes_and_rods(share, place, gap, a, b, inner):
    R = a + gap
    hollow = Fraction(inner, 10)

    def sector(u, v, w):
        theta, phi = 2 * pc.pi * u * share, 2 * pc.pi * v
        r = hollow + (1 - hollow) * w
        x, y = a * r * pc.cos(phi), b * r * pc.sin(phi)
        return (R + x) * pc.cos(theta), (R + x) * pc.sin(theta), y

    part = pc.compile_part(placed(sector, place))
    volume = float(2 * pi * share * R * pi * a * b * (1 - hollow**2))
    check_volume(part.report, volume)
    assert part.report.genus == ((1,) if inner else (0,))
    assert len(part.report.faces) == (4 if inner else 3)


@pytest.mark.parametrize("share", SHARES, ids=str)
@few(2)
@given(places, small, small, small)
def test_sectors_of_balls_and_cylinders(share, place, a, b, c):
    def ball(u, v, w):
        theta = 2 * pc.pi * u * share
        return (a * w * pc.sin(pc.pi * v) * pc.cos(theta),
                b * w * pc.sin(pc.pi * v) * pc.sin(theta), c * w * pc.cos(pc.pi * v))  # fmt: skip

    def cylinder(u, v, w):
        theta = 2 * pc.pi * u * share
        return a * v * pc.cos(theta), b * v * pc.sin(theta), c * w

    part = pc.compile_part(placed(ball, place))
    assert_solid(part, float(4 * pi / 3 * a * b * c * share), None, 3, exact=True)
    part = pc.compile_part(placed(cylinder, place))
    assert_solid(part, float(pi * a * b * c * share), None, 5, exact=True)
