"""Makes the conformance suite of `spec/conformance/`: valid datasets worked out by hand, and
named ways of breaking them. `python -m tests.conformance.build` writes it again.
"""
