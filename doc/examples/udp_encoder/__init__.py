"""Read heads behind an interface box that sends datagrams."""
