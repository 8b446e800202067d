"""The commands of ``deformnb``."""
