"""Where the CoM may be: regions, margins to their border, many at once, and the forces that hold it."""
