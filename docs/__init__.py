"""The documentation: its pages, and the Python that Sphinx builds them with."""
