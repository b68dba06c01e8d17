"""The `pliant` command: thin click commands over the other folders."""
