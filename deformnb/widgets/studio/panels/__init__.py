"""The panels of the studio, one for each tab."""
