"""Checks a dataset against every rule of the specification, all problems in one pass.

`validate` runs the rules in `rules/`; `issue_codes` is the catalogue of what they can report.
"""
