"""The web process: pages, API and their protection. It never opens the answers."""
