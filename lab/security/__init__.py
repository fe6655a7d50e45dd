"""Certificates of a system's processes and people, and the rules of what each may do, made from the table of topics."""
