"""Pictures of results: charts by matplotlib, pixels by OpenCV."""

from nvsdata.plots.calibration import reliability
from nvsdata.plots.charts import curves
from nvsdata.plots.classes import class_bars, confusion
from nvsdata.plots.drawing import save
from nvsdata.plots.events import event_image
from nvsdata.plots.sheets import captioned_sheet, contact_sheet
from nvsdata.plots.steps import marked
from nvsdata.plots.tradeoffs import front, tradeoff

__all__ = [
    "captioned_sheet",
    "class_bars",
    "confusion",
    "contact_sheet",
    "curves",
    "event_image",
    "front",
    "marked",
    "reliability",
    "save",
    "tradeoff",
]
