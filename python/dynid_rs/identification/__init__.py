"""The paper's three loops: friction, links, residual."""
