"""Files of volumes: a module for each format, and the table of formats by which they are read and written."""
