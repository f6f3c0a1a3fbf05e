"""Proofs over ranges of parameters: signs of det J that hold for every value of a box."""

from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pc2cad.domain.analysis import analyse, sample_sides
from pc2cad.errors import InputError
from pc2cad.solidity.jacobian_proof import proved_sign
from pc2cad.solidity.over_ranges.boxes import joined, within
from pc2cad.solidity.over_ranges.search import prove_over
from pc2cad.templates.file import parse_template, read_template
from pc2cad.templates.shipped import template_paths


def written(x, y, z, *names, domain=""):
    parameters = "\n".join(f"{name} = 0.5" for name in names)
    text = f'title = "t"\n[parameters]\n{parameters}\n[domain]\n{domain}\n'
    return parse_template(f'{text}[solid]\nx = "{x}"\ny = "{y}"\nz = "{z}"\n', "t", "t.toml")


def shipped(name):
    return read_template(template_paths()[name])


def proof(template, effort=1.0, values=None, **ranges):
    return prove_over(template.family(list(ranges), values), ranges, effort)


def test_polynomial_in_parameters_is_proved_at_once():
    found = proof(shipped("pyramid_cut"), p=("0.1", "0.9"), q=(0, "0.9"), r=("0.2", "0.9"))
    assert found.is_whole
    assert found.share == 1
    assert {box.sign for box in found.proved} == {-1}


def test_flat_corner_is_never_proved():
    """The pyramid cut off at all of its height is flat, and the only one that is."""
    found = proof(shipped("pyramid_cut"), 0.2, p=(0, 1), q=(0, 1), r=(0, 1))
    assert found.share > 0.99
    assert found.at({"p": 1, "q": 1, "r": 1}) is None
    assert found.at({"p": 1, "q": 1, "r": 0}).sign == -1
    assert all(high == 1 for _, (_, high) in found.open[-1])


@pytest.mark.parametrize(
    ("xyz", "ends", "limit"),
    [
        # det J is 1 - 2pu, by its Bernstein coefficients
        (("u", "v", "w*(1 - 2*p*u)"), (0, 1), Fraction(1, 2)),
        # 1 + 3p(2u - 1)
        (("u + 3*p*(u^2 - u)", "v", "w"), (0, 2), Fraction(1, 3)),
        # a sine of p half turns, by the turns alone
        (("w*cos(u)", "w*sin(u)", "-cos(pi*p*v)"), ("0.25", "1.75"), Fraction(1)),
        # √(1 + pu) - 1.1, by enclosures: p is below a root
        (("u", "v", "w*(sqrt(1 + p*u) - 1.1)"), (0, 1), Fraction(21, 100)),
    ],
)  # fmt: skip
def test_fold_beyond_a_value(xyz, ends, limit):
    found = proof(written(*xyz, "p"), p=ends)
    low, high = map(Fraction, ends)
    assert all(dict(box.spans)["p"][1] <= limit for box in found.proved)
    assert found.share == pytest.approx(float((limit - low) / (high - low)), abs=1e-3)


def test_sign_that_goes_with_a_parameter():
    found = proof(written("u", "v", "w*(sqrt(1 + p*u) - 1)", "p"), p=("-0.5", 1))
    assert found.share > 0.99
    assert not found.is_whole
    for box in found.proved:
        low, high = dict(box.spans)["p"]
        assert (low > 0 and box.sign == 1) or (high < 0 and box.sign == -1)


def test_two_parameters():
    """A torus folds where its tube is wider than its circle."""
    found = proof(shipped("torus"), 0.1, r=(1, 8), R=(1, 8))
    assert 0.44 < found.share <= 0.5
    for box in found.proved:
        spans = dict(box.spans)
        assert spans["r"][1] <= spans["R"][0]


def test_value_at_which_the_map_is_flat():
    found = proof(written("u", "v", "p*p*w", "p"), p=(-1, 1))
    assert found.at({"p": 0}) is None
    assert all(not box.holds({"p": Fraction(0)}) for box in found.proved)
    assert found.share > 0.99
    assert {box.sign for box in found.proved} == {1}


def test_root_of_a_square_whose_sign_goes_with_a_parameter():
    """√(2 - p)² is |2 - p|, and not 2 - p as it would be of a parameter that runs from 0 to 1."""
    found = proof(written("u", "v", "w*sqrt((2 - p)^2)", "p"), p=(1, 4))
    assert found.share > 0.99
    assert {box.sign for box in found.proved} == {1}
    assert all(not box.holds({"p": Fraction(2)}) for box in found.proved)


@pytest.mark.filterwarnings("error")
def test_poles_inside_the_box_are_open_without_a_warning():
    poles = written("u + (3*q + 2*w)*w", "u*v*w/(1 + p*v)", "w", "p", "q")
    assert proof(poles, p=(-2, -1), q=("-0.001", "0.001")).share == 0


def test_side_without_a_value_leaves_sides_open():
    found = proof(written("u", "v", "w*(p + sin(u)/u)", "p"), p=(1, 2))
    assert found.share_of_sides == 0


def test_map_that_is_flat_for_all_values():
    found = proof(written("u", "v", "p*u", "p"), p=(-1, 1))
    assert (found.share, found.looks, len(found.open)) == (0, 1, 1)


def test_domain_that_runs_backwards_is_not_proved():
    found = proof(written("u", "v", "w", "p", domain='u = [0, "p"]'), 0.2, p=(-1, 1))
    assert 0.49 < found.share <= 0.5
    assert all(dict(box.spans)["p"][0] > 0 for box in found.proved)


def test_enclosures_prove_a_channel_whose_wall_varies():
    found = proof(shipped("channel_ellipse"), delta=("0.3", "0.4"))
    assert found.is_whole
    assert found.spent > 1e6


def test_effort_is_counted_by_what_algebra_takes():
    """A look at thousands of coefficients, or nodes, takes many times that at a few."""
    few = written("u", "v", "w*(1 - 2*p*u)", "p")
    many = written(
        "(1 + u*(u + q))*cos(2*pi*v)*(v + p)", "(1 + u*(2 + w))*sin(2*pi*v)*p",
        "w*min(2, u + w)", "p", "q",
    )  # fmt: skip
    one, other = proof(few, 0.001, p=(0, 1)), proof(many, 0.1, p=(-1, 1), q=("0.25", "0.75"))
    assert one.spent / one.looks < 2e5
    assert other.spent / other.looks > 3e5
    waves = " + ".join(f"exp({k}*p*v)" for k in range(1, 200))
    large = written("u", "v", f"w*(1 + ({waves})^3/1e20)*(1 - p*u)", "p")
    found = proof(large, 0.02, p=(0, 2))
    assert found.spent / found.looks > 3e5


def test_at_takes_the_values_of_the_proof_only():
    found = proof(shipped("torus"), r=(1, 2), values={"R": 4})
    assert found.at({"R": 4, "r": 1.5}).sign == 1
    assert found.at({"R": 5, "r": 1.5}) is None
    assert found.at({"R": 4, "r": 2.5}) is None
    assert found.at({"r": 1.5}) is None


@pytest.mark.parametrize(
    ("name", "ranges"),
    [
        ("pyramid_cut", {"p": (0, 1), "q": (0, 1), "r": (0, 1)}),
        ("torus", {"R": (1, 4), "r": (1, 4)}),
        ("simplex_torus", {"epsilon": ("0.1", "0.9"), "turn": ("0.2", 1), "hole": (0, "0.9")}),
        ("elbow_pipe", {"R": (2, 6), "r": (1, 2)}),
        ("gerotor", {"ecc": (1, "1.5")}),
        ("triquadratic_cube", {"a": ("-0.5", "0.5"), "c": (-3, 3)}),
    ],
)  # fmt: skip
def test_each_value_of_a_proved_box_has_its_sign(name, ranges):
    template = shipped(name)
    found = proof(template, 0.2, **ranges)
    assert found.proved

    @settings(max_examples=7, deadline=None)
    @given(st.data())
    def holds(data):
        box = data.draw(st.sampled_from(found.proved))
        shares = data.draw(st.lists(st.integers(0, 64), min_size=len(box.spans),
                                    max_size=len(box.spans)))  # fmt: skip
        values = {
            n: float(a + (b - a) * Fraction(k, 64))
            for (n, (a, b)), k in zip(box.spans, shares, strict=True)
        }
        values = {n: min(max(x, float(a)), float(b)) for (n, (a, b)), x in
                  zip(box.spans, values.values(), strict=True)}  # fmt: skip
        assert proved_sign(sample_sides(template.bind(values)).map) == box.sign

    holds()


def test_boxes_that_share_a_side_are_joined():
    half, one = Fraction(1, 2), Fraction(1)
    quarters = [
        (("p", (a, a + half)), ("q", (b, b + half)))
        for a in (Fraction(0), half) for b in (Fraction(0), half)
    ]  # fmt: skip
    assert joined(quarters) == [(("p", (Fraction(0), one)), ("q", (Fraction(0), one)))]
    assert len(joined(quarters[:3])) == 2
    assert joined([]) == []


@pytest.mark.parametrize(
    ("names", "ranges", "words"),
    [
        (["p"], {"p": (1, 0)}, "the range of p, from 1 to 0, is empty"),
        (["p"], {"q": (0, 1)}, "the free parameters of pyramid_cut are p"),
        (["x"], {"x": (0, 1)}, "pyramid_cut has no parameter 'x'"),
    ],
)
def test_bad_ranges(names, ranges, words):
    with pytest.raises(InputError, match=words):
        prove_over(shipped("pyramid_cut").family(names), ranges)


def test_parameter_that_the_way_to_M_asks_for():
    with pytest.raises(InputError, match="the parameter pitch of spring cannot be left free"):
        shipped("spring").family(["pitch"])
    with pytest.raises(InputError, match="the parameter p of pyramid_cut is set, and left free"):
        shipped("pyramid_cut").family(["p"], {"p": 0.5})


RING = ("(h + (1 - h)*w)*cos(2*pi*t*v)", "(h + (1 - h)*w)*sin(2*pi*t*v)", "u")


@pytest.mark.parametrize(
    ("name", "ranges"),
    [
        ("pyramid_cut", {"p": ("0.2", "0.8"), "q": ("0.1", "0.9"), "r": ("0.2", "0.8")}),
        ("torus_tube", {"R": (4, 6), "r": ("0.5", 1), "wall": ("0.5", 1)}),
        ("ball_wedge", {"R": (1, 3), "turn": ("0.1", "0.9")}),
        ("bellows", {"N": (4, 6), "a": (2, 4), "R0": (15, 25)}),
        ("helical_channel", {"turns": ("1.5", "2.5"), "r": ("0.4", "0.6")}),
        ("wigley_hull", {"L": (8, 12), "B": ("0.8", "1.2"), "T": ("0.5", "0.8")}),
    ],
)  # fmt: skip
def test_boundary_is_that_of_each_value(name, ranges):
    template = shipped(name)
    found = proof(template, **ranges)
    assert found.share_of_sides == 1
    (box,) = found.proved
    for k in range(4):
        values = {
            n: float(a + (b - a) * Fraction(i * k % 5, 4))
            for i, (n, (a, b)) in enumerate(box.spans, 2)
        }
        own = analyse(template.bind(values)).boundary
        assert replace(box.boundary, labels=own.labels) == own


def test_ring_that_closes_at_one_value():
    """Of a ring over t turns, the ends are one at t = 1 and nowhere else below 2."""
    found = proof(written(*RING, "t", "h"), t=("0.5", "1.5"), values={"h": 0.25})
    assert found.is_whole
    assert 0.99 < found.share_of_sides < 1
    for box in found.proved:
        ((_, (low, high)),) = box.spans
        assert (box.boundary is None) == (low <= 1 <= high)


def test_hole_that_vanishes_at_one_value():
    found = proof(written(*RING, "t", "h"), h=(0, "0.5"), values={"t": 1})
    assert found.share == 1
    assert 0.99 < found.share_of_sides < 1
    assert found.at({"h": 0, "t": 1}).boundary is None
    assert len(found.at({"h": 0.25, "t": 1}).boundary.faces) == 4


def test_map_with_creases_has_no_boundary_over_ranges():
    found = proof(written("u", "v", "w*(2 + p + abs(u - 0.5))", "p"), p=(0, 1))
    assert found.share == 1
    assert found.share_of_sides == 0


@given(st.fractions(-2, 2), st.fractions(-2, 2))
def test_written_limits_are_within_their_box(one, other):
    low, high = sorted((one, other))
    ((near, far),) = within((("p", (low, high)),)).values()
    assert low <= Fraction(repr(near))
    assert Fraction(repr(far)) <= high


def test_written_decimals_stay():
    spans = (("p", (Fraction(1, 5), Fraction(4, 5))), ("q", (Fraction(-1, 10), Fraction(7))))
    assert within(spans) == {"p": [0.2, 0.8], "q": [-0.1, 7.0]}
