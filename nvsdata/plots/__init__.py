"""Pictures of results, drawn with OpenCV: events, contact sheets, curves."""

from nvsdata.plots.charts import curves
from nvsdata.plots.drawing import save
from nvsdata.plots.events import event_image
from nvsdata.plots.sheets import contact_sheet

__all__ = ["contact_sheet", "curves", "event_image", "save"]
