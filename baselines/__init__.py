"""Classical methods and controls, and the loop that turns any matcher into a submission."""
