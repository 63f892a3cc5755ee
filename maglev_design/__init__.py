"""From a magnetic-levitation rig's equations to a controller that runs on it."""

__version__ = "0.1.0"
