"""Where the files of a dataset are: loose in folders, packed in shards, or in two halves.

`layout` names every path, `files` finds a file, `packing` and `manifest` write published forms.
"""
