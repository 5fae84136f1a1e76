"""Renderers and the sensor: from instances to images."""
