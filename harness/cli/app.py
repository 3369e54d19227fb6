"""The typer application: the commands and the options of `harness` itself."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Annotated

import typer


def build(commands: Mapping[str, str]) -> typer.Typer:
    """The application with `commands`: the name of each, which is its function's too -> its module in harness.cli."""
    app = typer.Typer(
        help="Validate a GLSL Monte-Carlo path tracer against Mitsuba 3, both rendering the same scene file.",
        add_completion=False, pretty_exceptions_enable=False,
        rich_markup_mode=None,  # plain help: importing rich's would double the time to `harness --help`
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_root)
    for name, module in commands.items():
        app.command(name)(getattr(importlib.import_module(f"harness.cli.{module}"), name.replace("-", "_")))
    return app


def _root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        from importlib import metadata

        print(metadata.version("glsl-validation-harness"))
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())
        raise typer.Exit
