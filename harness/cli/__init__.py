"""The command line: one module a command, and what all commands share: errors in one line, and exit statuses.

To add a command, write `harness/cli/NAME.py` with a function `NAME` and put NAME into `COMMANDS`. The function's
docstring is the command's help; its first line stands in `harness --help`, and it ends with an example. It returns
nothing, or its exit status. Heavy packages (numpy, Mitsuba, moderngl, ...) are imported inside the function, for
every command's module is imported whichever command runs.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from harness.errors import HarnessError

COMMANDS = {
    "doctor": "doctor", "render": "render", "reference": "render", "compare": "compare", "study": "study",
    "report": "report", "bench": "bench",
}  # name of the command (and of its function) -> module under harness.cli

EXIT_USAGE = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, the shells' convention
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0 done and good; 1 a verdict went against the render; 2 bad input and 3 a lacking machine, both with one line on
    stderr. Any other exception is a bug of the harness and keeps its traceback.
    """
    try:
        status = _app()(args=arguments, prog_name="harness", standalone_mode=False)
        sys.stdout.flush()  # a reader that went away shows here at the latest
    except HarnessError as error:
        return _fail(str(error), error.exit_status)
    except typer.TyperException as error:  # a wrong option, argument or command name
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "harness"
        return _fail(f"{error.format_message().rstrip('.')}; see `{command} --help`", EXIT_USAGE)
    except (KeyboardInterrupt, typer.Abort):
        status = EXIT_INTERRUPTED
    except BrokenPipeError:
        return _end_quietly()
    except SystemExit as end:  # typer ends a broken pipe with 1, which here means that a verdict went against
        if not isinstance(end.__context__, BrokenPipeError):
            raise
        return _end_quietly()
    if status == EXIT_INTERRUPTED:
        print("harness: interrupted", file=sys.stderr)
    return status or 0


def console_script() -> None:
    """Entry point of the command `harness`."""
    sys.exit(main())


def _fail(message: str, status: int) -> int:
    print(f"harness: error: {' '.join(message.split())}", file=sys.stderr)
    return status


def _end_quietly() -> int:
    """After the reader of stdout went away. Python flushes stdout once more on exit, which must not raise again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    return EXIT_BROKEN_PIPE


def _app() -> typer.Typer:
    app = typer.Typer(
        help="Validate a GLSL Monte-Carlo path tracer against Mitsuba 3, both rendering the same scene file.",
        add_completion=False, pretty_exceptions_enable=False,
        rich_markup_mode=None,  # plain help: importing rich's would double the time to `harness --help`
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_root)
    for name, module in COMMANDS.items():
        app.command(name)(getattr(importlib.import_module(f"harness.cli.{module}"), name))
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
