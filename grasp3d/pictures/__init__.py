"""Pictures: a PyVista scene of surface, grasp, hand and table, and matplotlib figures."""
