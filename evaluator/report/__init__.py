"""Reports for people: HTML pages, plots, the leaderboard and the static site.

Plots need matplotlib; import from the modules, so that scoring alone never loads it.
"""
