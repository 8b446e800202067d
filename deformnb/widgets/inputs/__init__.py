"""Input widgets: curves, transfer functions, lists, tables, players."""
