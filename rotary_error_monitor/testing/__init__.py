"""Harness that runs nodes without launch files, with mock publishers and conditions instead of sleeps."""
