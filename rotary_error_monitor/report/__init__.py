"""Figures, tables and pages. The only room that imports plotting."""
