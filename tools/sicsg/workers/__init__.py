"""Workers: bodies, clothes, skinning and motion."""
