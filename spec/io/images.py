"""Reading and writing the two kinds of image: colour (PNG), depth with surface (EXR)."""

from pliant.spec.io.exr import Surface, read_surface, write_surface
from pliant.spec.io.png import read_rgb, write_rgb

__all__ = ["Surface", "read_rgb", "read_surface", "write_rgb", "write_surface"]
