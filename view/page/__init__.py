"""The page: one file in which a run can be watched, touched and handed on; or a live view."""

from .export import export_page
from .notebook import live
from .server import watch, watch_app

__all__ = ["export_page", "live", "watch", "watch_app"]
