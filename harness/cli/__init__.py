"""The command line: one module a command, and what all commands share: errors in one line, and exit statuses.

To add a command, write `harness/cli/NAME.py` with a function `NAME` and put NAME into `COMMANDS`. The function's
docstring is the command's help; its first line stands in `harness --help`, and it ends with an example. It returns
nothing, or its exit status. Heavy packages (numpy, Mitsuba, moderngl, ...) are imported inside the function, for
`harness --help` imports every command's module.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from types import FrameType

from harness.errors import HarnessError, MachineError

COMMANDS = {
    "doctor": "doctor", "render": "render", "reference": "render", "compare": "compare", "study": "study",
    "compare-studies": "compare_studies",
    "report": "report", "gallery": "gallery", "bench": "bench", "calibrate": "calibrate", "gate": "gate",
    "mutants": "mutants", "autopsy": "autopsy", "oracle": "oracle", "causes": "causes", "check": "check",
    "check-library": "library", "grade": "grade", "export": "export", "new-shader": "new", "new-scene": "new",
    "view": "view", "store": "store",
}  # name of the command (and of its function) -> module under harness.cli

EXIT_USAGE = 2
EXIT_INTERRUPTED = 130  # 128 + SIGINT, the shells' convention
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    0 done and good; 1 a verdict went against the render; 2 bad input and 3 a lacking machine, both with one line on
    stderr. Any other exception is a bug of the harness and keeps its traceback.
    """
    with _noting_interrupts() as interrupted:
        try:
            from harness.cli.app import build  # typer takes a while to import, in which Ctrl-C must end in one line

            words = sys.argv[1:] if arguments is None else arguments
            status = build(_needed(words))(args=arguments, prog_name="harness", standalone_mode=False)
            sys.stdout.flush()  # a reader that went away shows here at the latest
        except BaseException as error:
            if isinstance(error, KeyboardInterrupt) or interrupted.is_set():
                status = EXIT_INTERRUPTED
            elif (status := _explain(error)) is None:
                raise
    if status == EXIT_INTERRUPTED:
        print("harness: interrupted", file=sys.stderr)
    return status or 0


def _needed(words: Sequence[str]) -> dict[str, str]:
    """The command that is named first; all where none is, as for help. To build all of them takes a tenth of a
    second."""
    return {words[0]: COMMANDS[words[0]]} if words and words[0] in COMMANDS else COMMANDS


def console_script() -> None:
    """Entry point of the command `harness`."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by whoever started the process
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
        else:  # no character of a path or a table may end a command where the terminal cannot show it
            stream.reconfigure(errors="backslashreplace")
    sys.exit(main())


@contextmanager
def _noting_interrupts() -> Iterator[threading.Event]:
    """An event that Ctrl-C sets besides raising KeyboardInterrupt, which packages' imports turn into other errors."""
    interrupted = threading.Event()

    def note(number: int, frame: FrameType | None) -> None:
        interrupted.set()
        signal.default_int_handler(number, frame)

    ours = (threading.current_thread() is threading.main_thread()
            and signal.getsignal(signal.SIGINT) is signal.default_int_handler)
    if ours:
        signal.signal(signal.SIGINT, note)
    try:
        yield interrupted
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _explain(error: BaseException) -> int | None:
    """Say in one line what went wrong, and return the exit status; None for what is a bug of the harness."""
    import typer

    match error:
        case HarnessError():
            return _fail(str(error), error.exit_status)
        case typer.Abort():
            return EXIT_INTERRUPTED
        case typer.TyperException():  # a wrong option, argument or command name
            return _fail(_usage(error), EXIT_USAGE)
        case BrokenPipeError():
            return _end_quietly()
        case SystemExit() if isinstance(error.__context__, BrokenPipeError):
            return _end_quietly()  # typer ends a broken pipe with 1, which here means that a verdict went against
        case MemoryError():
            return _fail("not enough memory; choose a smaller --size", MachineError.exit_status)
        case OSError() if error.errno in (errno.ENOSPC, errno.EDQUOT):  # files of ours raise StoreError instead
            _discard_stdout()
            return _fail(f"the output cannot be written ({error.strerror}); send it elsewhere, or free some space",
                         EXIT_USAGE)
    return None


def _usage(error: Exception) -> str:
    """A message of typer's, with the value that it complains of and where the help is."""
    message = " ".join(str(getattr(error, "format_message", error.__str__)()).split()).rstrip(".")
    message = message.replace("Value error, ", "")
    details = getattr(error.__cause__, "errors", None)  # pydantic's, which leave out what was found
    found = f"'{details()[0]['input']}'" if details else ""
    if found not in message:
        message += f", found {found}"
    context = getattr(error, "ctx", None)
    return f"{message}; see `{context.command_path if context else 'harness'} --help`"


def _fail(message: str, status: int) -> int:
    print(f"harness: error: {' '.join(message.split())}", file=sys.stderr)
    return status


def _end_quietly() -> int:
    """After the reader of stdout went away."""
    _discard_stdout()
    return EXIT_BROKEN_PIPE


def _discard_stdout() -> None:
    """Python flushes stdout once more on exit, which must not raise again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
