"""The GLSL side: source assembly, scene to GLSL, headless rendering, probes."""
