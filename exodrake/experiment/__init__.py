"""Design of the next experiment: a safe motion on which the rival explanations differ most."""
