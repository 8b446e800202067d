"""Analysis of a deformation: folds, strain, fit quality, uncertainty, extent."""
