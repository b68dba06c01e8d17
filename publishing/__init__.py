"""Prepares a dataset for release: a public half to host and cite, and a private half.

Writes shards, dataset card, Croissant metadata and checksums.
"""

from pliant.publishing.publish import Published, publish
from pliant.publishing.settings import PublishSettings

__all__ = ["PublishSettings", "Published", "publish"]
