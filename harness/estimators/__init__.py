"""What is judged, and what it is held against; the only room that opens renderers."""
