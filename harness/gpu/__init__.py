"""moderngl, and nobody else: context, programs, ping-pong, probes."""
