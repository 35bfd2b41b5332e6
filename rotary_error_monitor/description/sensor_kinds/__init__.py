"""Kinds of listed sensors: what a file says of each, one file a kind."""
