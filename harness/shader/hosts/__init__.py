"""Hosts: the dialects in which accumulating fragment shaders are written, one file each."""
