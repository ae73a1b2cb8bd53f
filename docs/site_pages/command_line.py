"""The reference of the command line, from the parsers themselves."""

from __future__ import annotations

import argparse
import re

from mbd_sim.cli.main import build_parser

HEADER = """# Command line

`mbd_sim` is one program with the commands below. `mbd_sim COMMAND --help` prints the same text. A `FILE` is a mechanism
file, a URDF file, or the name of a [shipped mechanism](gallery/index.md).

Exit codes: 0, success; 1, a problem was reported, or `verify` found a difference; 2, wrong usage; 130, interrupted; 143, ended by SIGTERM.
"""


def pages() -> dict[str, str]:
    """The page by its name in `docs/generated/`."""
    lines = [HEADER]
    for name, parser in subparsers(build_parser()).items():
        lines += [f"## {name}\n", f"{_cells(parser.description or '')}\n", *_usage(parser)]
        for group in parser._action_groups:
            shown = [action for action in group._group_actions if action.help != argparse.SUPPRESS]
            if shown:
                lines += [
                    "| | |",
                    "|---|---|",
                    *(f"| {_name(action)} | {_meaning(action, parser)} |" for action in shown),
                    "",
                ]
    return {"command_line.md": "\n".join(lines)}


def subparsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """The parsers of the commands by name."""
    (action,) = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(action.choices)


def _usage(parser: argparse.ArgumentParser) -> list[str]:
    text = re.sub(r"\s+", " ", parser.format_usage().removeprefix("usage: ")).strip()
    return ["```text", text.replace("[-h] ", ""), "```", ""]


def _name(action: argparse.Action) -> str:
    value = action.metavar or (action.dest.upper() if action.nargs != 0 else "")
    if isinstance(value, tuple):
        value = " ".join(value)
    if not action.option_strings:
        return f"`{value}`"
    return ", ".join(
        f"`{option} {value}`" if value and action.nargs != 0 else f"`{option}`" for option in action.option_strings
    )


def _meaning(action: argparse.Action, parser: argparse.ArgumentParser) -> str:
    expanded = parser._get_formatter()._expand_help(action) if action.help else ""
    choices = f" One of {', '.join(f'`{choice}`' for choice in action.choices)}." if action.choices else ""
    return _cells(expanded + choices)


def _cells(text: str) -> str:
    """Text in which Markdown finds no markup."""
    return re.sub(r"([|*<\[\]_$])", r"\\\1", " ".join(text.split()))
