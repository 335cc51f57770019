"""The page: one file in which a run can be watched, touched and handed on."""

from .export import export_page

__all__ = ["export_page"]
