"""Formulas of the place as functions of 3MF's volumetric and implicit extensions, node by node.

Specification: https://github.com/3MFConsortium/spec_volumetric
"""

from __future__ import annotations

from typing import Any, Final

from pc2cad.domain.formulas import Formula, Step

#: what the function takes and gives
PLACE, VALUE = "pos", "value"
#: significant digits with which the library writes numbers of nodes, and how many such numbers
#: make one of double precision
DIGITS, PARTS = 6, 3
_UNARY: Final = {
    "sin": "Sin", "cos": "Cos", "tan": "Tan", "asin": "ArcSin", "acos": "ArcCos", "sinh": "Sinh",
    "cosh": "Cosh", "tanh": "Tanh", "exp": "Exp", "log": "Log", "sqrt": "Sqrt", "abs": "Abs",
    "sign": "Sign", "floor": "Floor",
}  # fmt: skip
_BINARY: Final = {
    "add": "Addition", "subtract": "Subtraction", "multiply": "Multiplication",
    "divide": "Division", "power": "Pow", "atan2": "ArcTan2", "min": "Min", "max": "Max",
}  # fmt: skip


def add_function(library: Any, model: Any, name: str, formula: Formula) -> Any:
    """Add a function of the place to a model; raise what the library raises."""
    function = model.AddImplicitFunction()
    function.SetIdentifier(name)
    function.SetDisplayName(name)
    given = function.AddInput(PLACE, PLACE, library.ImplicitPortType.Vector)
    nodes = _Nodes(library, function, given)
    for step in formula:
        nodes.put(step)
    result = function.AddOutput(VALUE, VALUE, library.ImplicitPortType.Scalar)
    function.AddLink(nodes.results[-1], result)
    return function


class _Nodes:
    def __init__(self, library: Any, function: Any, given: Any) -> None:
        self._function = function
        self._scalar = library.ImplicitNodeConfiguration.ScalarToScalar
        place = function.AddDecomposeVectorNode("place", "place", "")
        function.AddLink(given, place.GetInputA())
        self._place = {
            "x": place.GetOutputX(), "y": place.GetOutputY(), "z": place.GetOutputZ(),
        }  # fmt: skip
        self._count = 0
        #: of each step
        self.results: list[Any] = []

    def put(self, step: Step) -> None:
        given = [self.results[k] for k in step.operands]
        if step.operation in self._place:
            found = self._place[step.operation]
        elif step.operation == "constant":
            found = self._constant(step.value)
        elif step.operation == "select":
            node = self._function.AddSelectNode(self._name(), self._scalar, "", "")
            ports = (node.GetInputA(), node.GetInputB(), node.GetInputC(), node.GetInputD())
            found = self._linked(node, ports, given)
        elif step.operation in _UNARY:
            add = getattr(self._function, f"Add{_UNARY[step.operation]}Node")
            node = add(self._name(), self._scalar, "", "")
            found = self._linked(node, (node.GetInputA(),), given)
        else:
            found = self._both(step.operation, *given)
        self.results.append(found)

    def _both(self, operation: str, a: Any, b: Any) -> Any:
        node = getattr(self._function, f"Add{_BINARY[operation]}Node")(
            self._name(), self._scalar, "", ""
        )
        return self._linked(node, (node.GetInputA(), node.GetInputB()), (a, b))

    def _constant(self, value: float) -> Any:
        """Return a number as a sum of such as the library writes whole."""
        total, left = None, value
        for _ in range(PARTS):
            part = float(f"{left:.{DIGITS}g}")
            node = self._function.AddConstantNode(self._name(), "", "")
            node.SetConstant(part)
            found = node.GetOutputValue()
            total = found if total is None else self._both("add", total, found)
            left -= part
            if not left:
                break
        return total

    def _name(self) -> str:
        self._count += 1
        return f"n{self._count}"

    def _linked(self, node: Any, ports: Any, given: Any) -> Any:
        for port, value in zip(ports, given, strict=True):
            self._function.AddLink(value, port)
        return node.GetOutputResult()
