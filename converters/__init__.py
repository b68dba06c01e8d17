"""Imports data made by other tools, and converts datasets into their forms.

`marks_csv`, `annotation_tools` (COCO, LabelMe) and `knots` (the paper's) read points annotated in
tracks; `writer` writes them as a dataset. `convert` writes a dataset in the format of another tool.
"""

from pliant.converters.canvas import PictureOptions
from pliant.converters.formats import Source, read_source
from pliant.converters.import_settings import ImportSettings
from pliant.converters.writer import Imported, write_imported

__all__ = [
    "ImportSettings",
    "Imported",
    "PictureOptions",
    "Source",
    "read_source",
    "write_imported",
]
