"""Pictures: one scene of PyVista (surface, grasp, hand, table), and figures of matplotlib."""
