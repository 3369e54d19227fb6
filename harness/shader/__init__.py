"""GLSL as text: the library, its assembly, and the literals that a scene becomes. Needs no GL."""
