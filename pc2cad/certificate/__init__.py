"""Proof that det J keeps one sign: from factors, Bernstein coefficients, products, enclosures."""

from pc2cad.certificate.enclosure import sign_from_enclosures
from pc2cad.certificate.factors import sign_from_factors
from pc2cad.certificate.polynomial import sign_from_coefficients
from pc2cad.certificate.products import sign_from_products
from pc2cad.mapping import Mapping3


def proved_sign(mapping: Mapping3) -> int:
    """Return the sign of det J where it is proved to be one inside the box, else 0."""
    return (
        sign_from_factors(mapping)
        or sign_from_coefficients(mapping)
        or sign_from_products(mapping)
        or sign_from_enclosures(mapping)
    )
