"""Settings of the thesis that several transforms share."""

BETA = 0.5e-5  # weight of a squared time in µs² relative to a squared distance in pixels² (4.2)
T_VOL = 33_333  # duration of a volume in µs, 1/30 s (5.3.1)
