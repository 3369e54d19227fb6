"""The media of a report: each sets any document, since it knows blocks and never chapters."""
