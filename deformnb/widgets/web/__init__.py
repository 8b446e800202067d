"""Pages outside of Jupyter: trame's web server with a guard, and its remote controlled area."""
