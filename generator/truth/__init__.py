"""The ground truth: an exact rasteriser, visibility of points, and the frozen queries.

It is computed from the deformed geometry alone, and is the same for every render style.
"""
