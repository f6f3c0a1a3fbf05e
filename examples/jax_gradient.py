"""A solid within JAX: its volume and area as a function whose gradient is exact.

    python examples/jax_gradient.py        (needs the package jax)

JAX does not know how a solid's figures come about, and need not: a custom_vjp takes them and their
derivatives from the equation, and whatever JAX makes of them has a gradient. Of all cones the one
with h = 2√2 r has the least A³/V²; a few steps along the gradient find it.
"""

from __future__ import annotations

import math

import jax
import jax.numpy as jnp
import numpy as np

import pc2cad as pc
from pc2cad.checked import check_map

jax.config.update("jax_enable_x64", True)
NAMES = ("r", "h")
CONE = pc.read_template("cone")


def looked_at(values):
    """Return volume and area of the cone, (2,), and their derivatives by r and h, (2, 2)."""
    given = {name: float(value) for name, value in zip(NAMES, values, strict=True)}
    checked = check_map(CONE.bind(given))
    moved = [checked.sensitivity(name) for name in NAMES]
    return (
        np.array([checked.mass.volume, checked.mass.area]),
        np.array([[s.volume for s in moved], [s.area for s in moved]]),
    )


SHAPES = (jax.ShapeDtypeStruct((2,), float), jax.ShapeDtypeStruct((2, 2), float))


@jax.custom_vjp
def figures(values):
    return jax.pure_callback(looked_at, SHAPES, values)[0]


def forward(values):
    return jax.pure_callback(looked_at, SHAPES, values)


def backward(slopes, cotangent):
    return (cotangent @ slopes,)


figures.defvjp(forward, backward)


def cost(logarithms):
    """Return log(A³/V²), which no change of scale alters."""
    volume, area = figures(jnp.exp(logarithms))
    return 3 * jnp.log(area) - 2 * jnp.log(volume)


def main():
    slopes = jax.jacrev(figures)(jnp.array([3.0, 4.0]))
    place, gradient = jnp.log(jnp.array([3.0, 4.0])), jax.jit(jax.grad(cost))
    for _ in range(40):
        place = place - 0.9 * gradient(place)
    r, h = jnp.exp(place)
    slant = math.hypot(3, 4)
    return {
        "dV/dr": (float(slopes[0, 0]), 2 * math.pi * 3 * 4 / 3),
        "dA/dh": (float(slopes[1, 1]), math.pi * 3 * 4 / slant),
        "h/r of the best cone": (float(h / r), math.sqrt(8)),
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
