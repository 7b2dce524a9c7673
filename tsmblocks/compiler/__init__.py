"""From a diagram to one set of equations. Read ``dependencies``, ``flatten``, ``evaluate``, ``compile``."""
