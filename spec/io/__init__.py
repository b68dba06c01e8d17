"""Reads and writes single files: PNG, EXR, Parquet, JSON, and their checksums.

Every reader checks kind and size before it decodes, and refuses with one clear reason.
"""
