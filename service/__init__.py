"""The evaluation service: a challenge in one folder, its web pages, API, queue and workers."""
