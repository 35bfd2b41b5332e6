"""The blind check of diagnosis: cases with a sealed truth, diagnosed by a process that cannot see it, then scored."""
