"""The panels of the studio; widgets/studio/layout.py has their places."""
