"""Pictures of volumes: projections, ray casting, renderings, figures, movies."""
