"""The rules of a dataset, one module for each part of it; `validation.validate` runs them."""
