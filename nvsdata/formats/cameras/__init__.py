"""Files of calibrated cameras: DSEC, Kalibr, ROS and OpenCV."""
