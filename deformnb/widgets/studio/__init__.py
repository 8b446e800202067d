"""The studio: pictures, a view and panels around one session."""
