"""The report: web pages of a library of labelled meshes, readable without a network."""
