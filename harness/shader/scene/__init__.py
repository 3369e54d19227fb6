"""From a `Scene` to the GLSL chunk `scene.glsl`, a topic a file."""
