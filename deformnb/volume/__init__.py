"""Volumes and pictures as arrays with a place in space: grids, planes, sampling, transfer functions."""
