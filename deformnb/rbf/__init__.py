"""The paper's mathematics: control points, kernels, interpolation, rigid parts, cuts, extrusion, fields."""
