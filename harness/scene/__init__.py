"""Scene model and loader: a Mitsuba scene file becomes a small typed `Scene`."""
