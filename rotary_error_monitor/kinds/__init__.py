"""Kinds of things to be diagnosed that the core does not name, each a folder that a third party could have written."""
