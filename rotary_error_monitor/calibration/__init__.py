"""From measurements to the machine file that compensation runs on, and to the tables that controllers load."""
