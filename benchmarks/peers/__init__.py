"""Work against precision: what an answer costs, for kaju and for finite elements.

`python benchmarks/work_precision.py` runs it. Every job has a process of its own, so that peaks
of memory belong to one job; what is compiled or imported is not timed.
"""
