"""Plugin of napari: a volume in a layer is deformed by pairs of points that are dragged on it.

``napari.yaml`` lists what napari finds: the widget "Deform volume", readers and writers, sample data, commands of the
menus. A layer becomes a volume of deformnb, and results become layers, by :mod:`deformnb.interop`.
"""
