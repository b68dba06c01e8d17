"""The losses of Dense Object Nets, each alone in its module with its formula."""
