"""Dense Object Nets: training, matching, calibration and the report of a run.

`trainer` makes a run from a dataset, `matcher` answers queries with it.
"""
