"""Files of landmarks: tables, plain text and JSON of the programs with which landmarks are set."""
