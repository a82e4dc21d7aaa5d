"""Reading of untrusted mesh files into arrays."""
