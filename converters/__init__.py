"""Imports data made by other tools: one module per foreign format, one common writer.

`knots` reads the paper's annotations, `tapvid` point tracks; `writer` writes them as a dataset.
"""
