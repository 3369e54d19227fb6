"""Seeded bugs: one-line defects of the shader, and whether the gates notice them."""
