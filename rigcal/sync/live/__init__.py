"""Live sources, watched for the stamps of their frames."""
