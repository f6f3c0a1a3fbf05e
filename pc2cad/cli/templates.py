"""``pc2cad templates``: the shipped templates with their parameters."""

from __future__ import annotations

import argparse
from typing import Any

from pc2cad.cli.output import one_line, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add nothing: the verb has no arguments."""


def run(arguments: argparse.Namespace) -> int:
    """List name and title of every shipped template, and the parameters with their ranges."""
    from pc2cad.templates.shipped import bodies_paths, template_paths

    for name, path in (template_paths() | bodies_paths()).items():
        try:
            lines = _describe(path.read_bytes())
        except (OSError, ValueError) as error:
            lines = [f"cannot be read: {one_line(str(error))}"]
        say(f"{name}: {lines[0]}")
        for line in lines[1:]:
            say(f"    {line}")
    return 0


def _describe(raw: bytes) -> list[str]:
    import tomllib

    data = tomllib.loads(raw.decode("utf-8"))
    lines = [one_line(str(data.get("title", "")))]
    parameters = data.get("parameters", {})
    for name, given in parameters.items() if isinstance(parameters, dict) else ():
        table = given if isinstance(given, dict) else {"default": given}
        about = f"  {one_line(str(table['about']))}" if "about" in table else ""
        lines.append(f"{name} = {table.get('default')}{_range(table)}{about}")
    return lines


def _range(table: dict[str, Any]) -> str:
    low, high = table.get("min"), table.get("max")
    if low is None and high is None:
        return ""
    if high is None:
        return f"  (from {low})"
    return f"  ({low} to {high})" if low is not None else f"  (to {high})"
