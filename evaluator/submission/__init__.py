"""Reads a submission without trusting it: file, rows, queries and truth in blocks of pairs.

`check` and `evaluate` share `loading`: what one accepts, the other can score.
"""
