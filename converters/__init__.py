"""Imports data made by other tools: one module per foreign format, one common writer.

`knots` reads the paper's annotations, `tapvid` point tracks; `writer` writes them as a dataset.
"""

from pliant.converters.formats import Source, read_source
from pliant.converters.writer import Imported, ImportSettings, write_imported

__all__ = ["ImportSettings", "Imported", "Source", "read_source", "write_imported"]
