"""Reports for people: HTML pages with charts, the leaderboard and the static site.

`vendor/` has the library that draws the charts in the browser.
"""
