"""Scores anybody's answers by a named protocol; needs neither torch, Blender nor OpenCV."""
