"""Sizes of the largest messages that are accepted, bytes; a separate module, so that its import needs no schemas."""

MAX_JSON_BYTES = 1 << 20
"""Largest JSON payload of a message, bytes; a larger one is refused."""

MAX_BULK_BYTES = 64 << 20
"""Largest raw array of a message, bytes, which a 4096 x 4096 float32 map fills; a larger one is refused."""
