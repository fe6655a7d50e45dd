"""Answers of the service: between messages and the algorithms."""
