"""The interactive viewer: one state and one scene, shown in a window, a page or a picture."""
