"""From a diagram to one set of equations. Read ``flatten``, ``dependencies``, ``evaluate``, ``compile``."""
