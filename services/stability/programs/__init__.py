"""Contacts, the cone programs over them, their solver, and fans of directions answered with proof."""
