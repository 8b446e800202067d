"""Shared utilities: paths, atomic writing, memory checks, errors, streams, and decoding of text and pictures."""
