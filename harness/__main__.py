"""`python -m harness`: the same as the command `harness`."""

from harness.cli import console_script

console_script()
