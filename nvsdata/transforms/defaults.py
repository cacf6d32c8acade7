"""Settings of the thesis that several transforms share."""

from nvsdata.data.pseudo import Pseudo

# eq. 4.2's weight of a squared time in µs² relative to a squared distance in pixels². The author's code scales time
# by 0.5e-5 per µs and then squares it: in his graphs 30 ms are 0.15 pixels. Read literally, the text's beta is 0.5e-5.
TIME_SCALE = 0.5e-5
BETA = TIME_SCALE**2
LITERAL_BETA = 0.5e-5
T_VOL = 33_333  # duration of a volume in µs, 1/30 s (5.3.1)
PSEUDO: Pseudo = "signed"  # the author's code; the text (4.2.1) has "abs"
REACH_T = 15_000  # µs between the ends of an edge that few edges in windows of 30 ms exceed
SCALES = (0.5, 0.667, 0.833, 1.0)  # of multi-scale crops (3.5.1)
