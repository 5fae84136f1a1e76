"""Where frames and detections come from."""
