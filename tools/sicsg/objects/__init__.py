"""The makers of the catalogue's meshes, one module per family; ``catalog.py`` lists them."""
