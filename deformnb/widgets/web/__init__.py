"""Pages in a browser without Jupyter: trame's server with its doors shut, and its remote controlled area."""
