"""Files of surfaces: PLY, STL, OBJ and VTP."""
