"""The viewer as a page: every visitor has a session and a picture of their own."""
