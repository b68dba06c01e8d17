"""The rules of a dataset, one module for each part of it; `pliant.spec.validate` runs them."""
