"""Somebody else's shader: run in a child process, what it does with its past found by experiment, its faults named."""
