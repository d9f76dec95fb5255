"""What a controller gains from a diagnosis: controllers tuned on diagnosed models run on the withheld robots."""
