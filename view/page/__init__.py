"""The page: one file in which a run can be watched, touched and handed on.

In comes a scene, a model or a result; out goes HTML with data and programs in it.
Read `export` (the file), `data` (what is asked, what moves, numbers as text), then the JavaScript
beside them.
"""
