"""Files of transforms: those of ITK, elastix and VTK, displacement fields as images, and OME-NGFF."""
