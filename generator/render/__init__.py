"""The render styles: `photo`, `fast` and `raster`."""
