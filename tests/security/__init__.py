"""Attacks on the server, and on what reads and writes files: each is refused."""
