"""Proof that det J keeps one sign: from factors, Bernstein coefficients, products, enclosures."""

from pc2cad.arrays import Array
from pc2cad.bounds.known import Models
from pc2cad.domain.map import Mapping3
from pc2cad.solidity.jacobian_proof.enclosures import sign_from_enclosures
from pc2cad.solidity.jacobian_proof.factors import has_known_ranges, sign_from_factors
from pc2cad.solidity.jacobian_proof.polynomial import sign_from_coefficients
from pc2cad.solidity.jacobian_proof.separable import sign_from_products


def proved_sign(
    mapping: Mapping3,
    open_places: list[Array] | None = None,
    models: list[Models] | None = None,
) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0.

    Middles of boxes in which it was not are added to `open_places`, as arrays (3, n), and to
    `models` those of trees on boxes that fill the box.
    """
    left = [] if open_places is None else open_places
    soon = has_known_ranges(mapping)
    return (
        (soon and sign_by_algebra(mapping))
        or (mapping.even and sign_from_factors(Mapping3(mapping.even, mapping.parameters)))
        or sign_from_products(mapping, left, models)
        or (not soon and sign_by_algebra(mapping))
        or sign_from_enclosures(mapping, left)
    )


def sign_by_algebra(mapping: Mapping3) -> int:
    """Return the sign where the two proofs show it that end soon, whatever they find."""
    return sign_from_factors(mapping) or sign_from_coefficients(mapping)
