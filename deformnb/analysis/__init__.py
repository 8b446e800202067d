"""What a deformation does: folds, strain, fit quality, uncertainty, extent."""
