"""The rope: curves, strands, knots and episodes."""
