"""The report's figures and images: one module a kind, all drawn through `svg`, all dressed by `style`."""
