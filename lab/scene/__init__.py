"""Picture of a run made from its messages, which the report, the live view, `render` and Foxglove export show."""
