"""Charts and images of results: charts by matplotlib, images by OpenCV.

Every function returns an image as uint8 [H, W, 3] in BGR, which `save_png` writes.
"""

from nvsdata.plots.charts import curves, pareto_front, points_chart, tradeoff
from nvsdata.plots.classification import class_bars, confusion, reliability
from nvsdata.plots.drawing import event_image, save_png
from nvsdata.plots.sheets import captioned_sheet, contact_sheet

__all__ = [
    "captioned_sheet",
    "class_bars",
    "confusion",
    "contact_sheet",
    "curves",
    "event_image",
    "pareto_front",
    "points_chart",
    "reliability",
    "save_png",
    "tradeoff",
]
