"""The documentation as a site: what `make docs` does beside calling mkdocs."""
