"""Regions in which the contacts hold the CoM, margins to their border, many sets at once, and the forces."""
