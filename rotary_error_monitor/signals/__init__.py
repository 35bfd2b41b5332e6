"""Sampled signals: blocks as they travel, streams as they are joined, values at a common time."""
