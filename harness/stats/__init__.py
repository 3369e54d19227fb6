"""Verdicts and fits on plain arrays; knows nothing of scenes, renderers or files."""
