"""Certificates of a system's processes and people, and access rules for them, made from the table of topics."""
