"""What the thesis sets for several transforms."""

BETA = 0.5e-5  # weight of a squared time (µs) beside a squared distance in pixels (4.2)
T_VOL = 33_333  # µs of a volume, 1/30 s (5.3.1)
