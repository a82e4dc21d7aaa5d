"""A session drawn by PyVista, in a window or off screen."""
