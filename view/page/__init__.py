"""The page: one file in which a run can be watched, touched and handed on."""
