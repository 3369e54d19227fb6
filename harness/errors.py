"""The harness's own exceptions; each ends a command in one clear line and a fixed exit status."""

from __future__ import annotations


class HarnessError(Exception):
    """Bad input: the message is one line that says where, what was found, what is allowed, how to mend it.

    Commands print the message to stderr without a traceback and exit with `exit_status`.
    """

    exit_status = 2


class SceneError(HarnessError):
    """A scene file that is malformed or outside the supported subset; the message begins `file:line:`."""


class ShaderError(HarnessError):
    """A GLSL source that does not compile, link or resolve its includes; the message names file and line."""


class StoreError(HarnessError):
    """A file of results that is missing, truncated, unwritable, or not what it should be."""


class MachineError(HarnessError):
    """The machine lacks something (a library, a driver); the message holds the line that installs it."""

    exit_status = 3
