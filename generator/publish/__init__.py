"""Publishing a dataset: a public half that others host, load and cite, and a private one."""

from pliant.generator.publish.publish import Published, PublishSettings, publish

__all__ = ["PublishSettings", "Published", "publish"]
