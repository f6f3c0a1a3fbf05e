"""Formulas as functions of 3MF's volumetric and implicit extensions, node by node.

Specification: https://github.com/3MFConsortium/spec_volumetric
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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


def add_functions(library: Any, model: Any, formulas: Mapping[str, Formula]) -> dict[str, Any]:
    """Add functions of the place to a model, and those that they call; raise what it raises."""
    known: dict[int, Any] = {}
    found = {}
    for name, formula in formulas.items():
        for called in _called(formula):
            if id(called) not in known:
                function = _started(library, model, f"{called.name}{len(known)}")
                ports = [function.AddInput(x, x, _scalar(library)) for x in called.inputs]
                _filled(library, function, called, ports, known)
                known[id(called)] = function
        function = _started(library, model, name)
        given = function.AddInput(PLACE, PLACE, library.ImplicitPortType.Vector)
        place = function.AddDecomposeVectorNode("place", "place", "")
        function.AddLink(given, place.GetInputA())
        ports = [place.GetOutputX(), place.GetOutputY(), place.GetOutputZ()]
        _filled(library, function, formula, ports, known)
        found[name] = function
    return found


def _called(formula: Formula) -> Iterator[Formula]:
    """Yield the formulas that one calls, those that these call first."""
    for step in formula.steps:
        if step.formula is not None:
            yield from _called(step.formula)
            yield step.formula


def _started(library: Any, model: Any, name: str) -> Any:
    function = model.AddImplicitFunction()
    function.SetIdentifier(name)
    function.SetDisplayName(name)
    return function


def _scalar(library: Any) -> Any:
    return library.ImplicitPortType.Scalar


def _filled(
    library: Any, function: Any, formula: Formula, ports: Sequence[Any], known: Mapping[int, Any]
) -> None:
    """Give a function its nodes and outputs."""
    nodes = _Nodes(library, function, ports, known)
    for step in formula.steps:
        nodes.put(step)
    for name, k in formula.outputs.items():
        result = function.AddOutput(name, name, _scalar(library))
        function.AddLink(nodes.results[k][0], result)


class _Nodes:
    def __init__(
        self, library: Any, function: Any, given: Sequence[Any], known: Mapping[int, Any]
    ) -> None:
        self._function, self._given, self._known = function, given, known
        self._scalar = library.ImplicitNodeConfiguration.ScalarToScalar
        self._port = _scalar(library)
        self._count = 0
        #: the formulas that are called, by their resources
        self._names: dict[int, Any] = {}
        #: what each step gives: of a call all that it gives
        self.results: list[list[Any]] = []

    def put(self, step: Step) -> None:
        given = [self.results[k][0] for k in step.operands]
        if step.operation == "input":
            found = self._given[int(step.value)]
        elif step.operation == "constant":
            found = self._constant(step.value)
        elif step.operation == "output":
            found = self.results[step.operands[0]][int(step.value)]
        elif step.operation == "select":
            node = self._function.AddSelectNode(self._name(), self._scalar, "", "")
            ports = (node.GetInputA(), node.GetInputB(), node.GetInputC(), node.GetInputD())
            found = self._linked(node, ports, given)
        elif step.formula is not None:
            self.results.append(self._call(step.formula, given))
            return
        elif step.operation in _UNARY:
            add = getattr(self._function, f"Add{_UNARY[step.operation]}Node")
            node = add(self._name(), self._scalar, "", "")
            found = self._linked(node, (node.GetInputA(),), given)
        else:
            found = self._both(step.operation, *given)
        self.results.append([found])

    def _call(self, formula: Formula, given: Sequence[Any]) -> list[Any]:
        if id(formula) not in self._names:
            name = self._function.AddResourceIdNode(self._name(), "", "")
            name.SetResource(self._known[id(formula)])
            self._names[id(formula)] = name.GetOutputValue()
        node = self._function.AddFunctionCallNode(self._name(), "", "")
        self._function.AddLink(self._names[id(formula)], node.GetInputFunctionID())
        for port, value in zip(formula.inputs, given, strict=True):
            taken = node.AddInput(port, port)
            taken.SetType(self._port)
            self._function.AddLink(value, taken)
        found = [node.AddOutput(port, port) for port in formula.outputs]
        for port in found:
            port.SetType(self._port)
        return found

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
