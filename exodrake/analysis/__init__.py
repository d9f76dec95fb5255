"""The closed loop: steps, sampled-data poles, stability map, frequency response, margins (`docs/closed_loop.md`)."""
