"""What a session shows, drawn by PyVista, whoever opens the window."""
