"""A solid as a component of OpenMDAO, with exact derivatives: the cone of 100 mm³ with least area.

    python examples/openmdao_cone.py        (needs the package openmdao)

A component gives volume and area of a template and their partial derivatives from the equation; an
optimiser of OpenMDAO finds r and h. Of all cones the one with h = 2√2 r has the least area.
"""

from __future__ import annotations

import math

import openmdao.api as om

import pc2cad as pc
from pc2cad.checked import check_map

VOLUME = 100.0


class Solid(om.ExplicitComponent):
    """Volume and area of a template; every parameter that is named is an input."""

    def initialize(self):
        self.options.declare("template")
        self.options.declare("names")

    def setup(self):
        bound = self.options["template"].bind().parameters
        for name in self.options["names"]:
            self.add_input(name, bound[name])
        self.add_output("volume")
        self.add_output("area")
        self.declare_partials("*", "*")

    def checked(self, inputs):
        given = {name: float(inputs[name][0]) for name in self.options["names"]}
        return check_map(self.options["template"].bind(given))

    def compute(self, inputs, outputs):
        mass = self.checked(inputs).mass
        outputs["volume"], outputs["area"] = mass.volume, mass.area

    def compute_partials(self, inputs, partials):
        checked = self.checked(inputs)
        for name in self.options["names"]:
            moved = checked.sensitivity(name)
            partials["volume", name], partials["area", name] = moved.volume, moved.area


def main():
    problem = om.Problem(reports=False)
    solid = Solid(template=pc.read_template("cone"), names=("r", "h"))
    problem.model.add_subsystem("cone", solid, promotes=["*"])
    problem.model.add_design_var("r", lower=0.5, upper=20)
    problem.model.add_design_var("h", lower=0.5, upper=20)
    problem.model.add_constraint("volume", equals=VOLUME)
    problem.model.add_objective("area", ref=VOLUME)
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-12, disp=False)
    problem.setup()
    problem.run_driver()
    r = (3 * VOLUME / (math.pi * math.sqrt(8))) ** (1 / 3)
    return {
        "volume": (float(problem["volume"][0]), VOLUME),
        "r": (float(problem["r"][0]), r),
        "h": (float(problem["h"][0]), math.sqrt(8) * r),
        "area": (float(problem["area"][0]), 4 * math.pi * r**2),
    }


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g}, exact {exact:.9g}")
