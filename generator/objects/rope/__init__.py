"""Ropes: shapes, knots, geometry, material points and episodes."""
