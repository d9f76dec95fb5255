"""Cable-driven wrist of a da Vinci instrument."""
