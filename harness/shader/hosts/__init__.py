"""Hosts: the dialects in which accumulating fragment shaders are written, one file each."""

from harness.shader.hosts.recognition import read

__all__ = ["read"]
