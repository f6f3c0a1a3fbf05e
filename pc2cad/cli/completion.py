"""``pc2cad completion``: a script that lets a shell complete verbs, options and templates."""

from __future__ import annotations

import argparse
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

from pc2cad.cli.output import say

_BASH: Final = """\
# eval "$(pc2cad completion bash)", for example in ~/.bashrc; in ~/.zshrc the same with zsh
if [ -n "${{ZSH_VERSION-}}" ]; then autoload -U +X bashcompinit && bashcompinit; fi
_pc2cad() {{
  local current="${{COMP_WORDS[COMP_CWORD]}}" words=""
  case "${{COMP_WORDS[COMP_CWORD-1]}}" in
    --view) COMPREPLY=($(compgen -W "{views}" -- "$current")); return ;;
    -s|--set|--vary|--slider)
      case "${{COMP_WORDS[2]}}" in
{parameters}
      esac
      compopt -o nospace 2>/dev/null
      COMPREPLY=($(compgen -S = -W "$words" -- "$current")); return ;;
  esac
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{verbs}" -- "$current")); return
  fi
  case "${{COMP_WORDS[1]}}" in
{options}
  esac
  case "$current" in
    -*) COMPREPLY=($(compgen -W "$words" -- "$current")) ;;
    *) COMPREPLY=($(compgen -W "{templates}" -- "$current") $(compgen -f -- "$current")) ;;
  esac
}}
complete -F _pc2cad pc2cad
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the shell."""
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="which shell")


def run(arguments: argparse.Namespace) -> int:
    """Print the script."""
    from pc2cad.cli.main import VERBS, make_parser
    from pc2cad.picture.camera import VIEWS
    from pc2cad.templates.shipped import bodies_paths, template_paths

    options = _options(make_parser())
    templates = template_paths() | bodies_paths()
    if arguments.shell == "fish":
        say("\n".join(_fish(VERBS, options, list(templates))))
    else:
        rows = [f'    {verb}) words="{" ".join(names)}" ;;' for verb, names in options.items()]
        say(_BASH.format(
            verbs=" ".join(VERBS), options="\n".join(rows), templates=" ".join(templates),
            views=" ".join(VIEWS), parameters="\n".join(_parameters(templates)),
        ).rstrip())  # fmt: skip
    return 0


def _parameters(templates: Mapping[str, Path]) -> Iterator[str]:
    """Yield a shell's case of every shipped template that has parameters."""
    for name, path in templates.items():
        found = tomllib.loads(path.read_text(encoding="utf-8")).get("parameters", {})
        if found:
            yield f'      {name}) words="{" ".join(found)}" ;;'


def _options(parser: argparse.ArgumentParser) -> dict[str, list[str]]:
    """Return the options of every verb."""
    verbs = next(a for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    return {
        name: [option for action in verb._actions for option in action.option_strings]
        for name, verb in verbs.choices.items()
    }


def _fish(
    verbs: Mapping[str, str], options: Mapping[str, list[str]], templates: list[str]
) -> list[str]:
    lines = ["# pc2cad completion fish | source, for example in ~/.config/fish/config.fish"]
    for verb, purpose in verbs.items():
        told = purpose.replace("'", r"\'")
        lines.append(f"complete -c pc2cad -n __fish_use_subcommand -a {verb} -d '{told}'")
        when = f"-n '__fish_seen_subcommand_from {verb}'"
        for option in options[verb]:
            kind = "l" if option.startswith("--") else "s"
            lines.append(f"complete -c pc2cad {when} -{kind} {option.lstrip('-')}")
        lines.append(f"complete -c pc2cad {when} -a '{' '.join(templates)}'")
    return lines
