"""Linear answers of a mechanism: state-space models, frequency responses and random vibration."""
