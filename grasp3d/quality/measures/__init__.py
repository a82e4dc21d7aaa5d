"""Quality measures of the literature besides epsilon: one module for each kind, and their list."""
