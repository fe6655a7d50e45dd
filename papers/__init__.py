"""Reproduction of papers: their figures and numbers computed by this code, beside those printed (`surefoot
reproduce`)."""
