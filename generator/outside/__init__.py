"""Brings in data made elsewhere: the paper's own annotations, and point tracks of TAP-Vid."""
